"""A log made from other files appears whole or not at all: what a run measured is kept, a copy can be made again.

It is written under a hidden name and gets its own when it is complete.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from campaigns.log import own
from campaigns.log.checksum import sidecar_of
from campaigns.log.failure import cannot
from campaigns.log.schema import ChannelLike
from campaigns.log.write import LogWriter, require_new
from sim_backend.errors import MccdError
from sim_backend.safe_write import give_name, hidden_name, write_text


@contextlib.contextmanager
def whole_log(target: Path, channels: Sequence[ChannelLike], **about: Any) -> Iterator[LogWriter]:
    """Give a writer of the new log `target`; `channels` and what it is `about` as for `LogWriter.create`.

    Raises ConfigError for an existing path, DataError when the file cannot be completed: then it is removed.
    """
    require_new(target)
    hidden = hidden_name(target)
    try:
        with LogWriter.create(hidden, channels, **about) as log:
            yield log
        digest = sidecar_of(hidden).read_text(encoding="utf-8").partition(" ")[0]
        give_name(hidden, target, replace=False)
        try:
            write_text(sidecar_of(target), f"{digest}  {target.name}\n")
        except BaseException:
            target.unlink()
            raise
        own.keep(target)
    except MccdError as error:
        raise type(error)(str(error).replace(str(hidden), str(target))) from None
    except OSError as error:
        raise cannot("complete", target, error) from None
    finally:
        for path in (hidden, sidecar_of(hidden)):
            path.unlink(missing_ok=True)
