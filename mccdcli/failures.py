"""What becomes of an error: one line on standard error and an exit code, never a traceback."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable

import click

from mccdcli.output import discard, say
from sim_backend.errors import ConfigError, DataError, MccdError

USAGE = ConfigError.exit_code
BUG = 70  # EX_SOFTWARE of sysexits.h
INTERRUPTED = 130  # 128 + SIGINT, as a shell reports it
DISK = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO})
BROKEN_PIPE = 141  # 128 + SIGPIPE
MOST_CHARACTERS = 1200
"""Of a message: what a file or a user says may be of any length, what happened and the fix stand at its ends."""


def exit_code_of(run: Callable[[], object]) -> int:
    """Call `run` and return the exit code: the number that it returns, 0 for none, or that of its error."""
    try:
        code = run()
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except click.exceptions.Exit as error:
        return error.exit_code
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return USAGE
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "mccd"
        return _refuse(f"{error.format_message()} (see '{command} --help')", USAGE)
    except click.ClickException as error:
        return _refuse(error.format_message(), USAGE)
    except (click.Abort, KeyboardInterrupt):
        say("mccd: interrupted")
        return INTERRUPTED
    except MccdError as error:
        return _refuse(str(error), error.exit_code)
    except MemoryError as error:
        what = f" ({error})" if str(error) else ""
        return _refuse(
            f"there is not enough memory{what}; ask for less at once, or for more memory", DataError.exit_code
        )
    except BrokenPipeError:
        discard(sys.stdout)
        return BROKEN_PIPE
    except OSError as error:
        # with a file name, or for these reasons, it is the state of the user's disk or folder
        if error.filename is None and error.errno not in DISK:
            return _report_bug(error)
        where = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
        fix = "check the folder, its rights and the free space"
        return _refuse(f"{where}{error.strerror}; {fix}", DataError.exit_code)
    except Exception as error:
        return _report_bug(error)


def _refuse(message: str, exit_code: int) -> int:
    line = " ".join(message.split())
    if len(line) > MOST_CHARACTERS:
        half = MOST_CHARACTERS // 2
        line = f"{line[:half]} … {line[-half:]}"
    try:
        say(f"mccd: error: {line}")
    except BrokenPipeError:  # nobody listens, and the exit code says it too
        discard(sys.stderr)
    return exit_code


def _report_bug(error: Exception) -> int:
    from mccdcli.crash import write_crash_file

    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    file = write_crash_file(error)
    told = f"together with {file}" if file else "with the command line; no file with the details could be written"
    return _refuse(f"this is a bug in mccd ({what}); please report it {told}", BUG)
