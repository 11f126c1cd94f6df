"""The tree of commands: nothing is imported before it is needed, and every line of the table holds."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator

import click
import pytest
from click.testing import CliRunner

from mccdcli.lazy import LazyGroup
from mccdcli.main import cli
from mccdcli.registry import COMMANDS, GROUPS, Entry

# what costs more than a few milliseconds to import, or is ours and may import such
HEAVY = {"analysis", "campaigns", "control", "h5py", "jinja2", "matplotlib", "msgspec", "numba", "numpy"} | {
    "pandas",
    "rich",
    "scipy",
    "serial",
}


ONE = """
import atexit, io, json, os, sys
from mccdcli.main import main

def run(arguments, told):
    sys.stdout = io.TextIOWrapper(io.BytesIO(), write_through=True)
    atexit.register(lambda: os.write(told, json.dumps([sys.stdout.buffer.tell(), sorted(sys.modules)]).encode()))
    sys.exit(main(arguments))
"""
"""Runs one command, and tells at its end how much it has printed and the names of all modules that it has imported."""

FRESH = ONE + "run(sys.argv[1:], 2)"

FORKED = (
    ONE
    + """
for line in sys.stdin:
    arguments, environment = json.loads(line)
    ours, theirs = os.pipe()
    if os.fork() == 0:
        os.environ.update(environment)
        run(arguments, theirs)
    os.close(theirs)
    with open(ours) as told:
        print(told.read(), flush=True)
    os.wait()
"""
)
"""A copy of an interpreter that has imported nothing but the entry does as a fresh one, in a tenth of the time."""

Modules = Callable[..., set[str]]


@pytest.fixture(scope="module")
def modules_after() -> Iterator[Modules]:
    """Return a function that runs `mccd ARGUMENTS` and returns the names of all modules that it has imported."""
    with subprocess.Popen(
        [sys.executable, "-c", FORKED], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:

        def run(*arguments: str, **environment: str) -> set[str]:
            assert process.stdin is not None and process.stdout is not None
            process.stdin.write(json.dumps([arguments, os.environ | environment]) + "\n")
            process.stdin.flush()
            printed, modules = json.loads(process.stdout.readline())
            assert printed > 0
            return set(modules)

        yield run


def test_a_copy_imports_what_a_fresh_interpreter_does(modules_after: Modules) -> None:
    for words in (["--help"], ["chop", "--help"]):
        done = subprocess.run([sys.executable, "-c", FRESH, *words], capture_output=True, text=True, timeout=60)
        assert set(json.loads(done.stderr)[1]) == modules_after(*words)


def roots(modules: set[str]) -> set[str]:
    return {name.partition(".")[0] for name in modules}


def commands_in(modules: set[str]) -> set[str]:
    return {name for name in modules if name.startswith("mccdcli.commands.")}


@pytest.mark.parametrize("group", ["", *GROUPS])
def test_help_of_a_group_imports_neither_a_command_nor_anything_heavy(modules_after: Modules, group: str) -> None:
    modules = modules_after(*group.split(), "--help")
    assert roots(modules) & HEAVY == set()
    assert commands_in(modules) == set()


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_a_command_imports_nothing_heavy(modules_after: Modules, name: str) -> None:
    modules = modules_after(*name.split(), "--help")
    assert roots(modules) & HEAVY == set()
    assert commands_in(modules) == {COMMANDS[name].target.partition(":")[0]}


@pytest.mark.parametrize("group", ["", *GROUPS])
def test_completing_a_name_imports_no_command(modules_after: Modules, group: str) -> None:
    words = ["mccd", *group.split(), ""]
    modules = modules_after(_MCCD_COMPLETE="bash_complete", COMP_WORDS=" ".join(words), COMP_CWORD=str(len(words) - 1))
    assert "mccdcli.lazy" in modules
    assert roots(modules) & HEAVY == set()
    assert commands_in(modules) == set()


@pytest.mark.parametrize("name", COMMANDS)
def test_completing_an_option_imports_nothing_heavy(modules_after: Modules, name: str) -> None:
    words = ["mccd", *name.split(), "--"]
    modules = modules_after(_MCCD_COMPLETE="bash_complete", COMP_WORDS=" ".join(words), COMP_CWORD=str(len(words) - 1))
    assert roots(modules) & HEAVY == set()


@pytest.mark.parametrize("beside", [{}, {"COMP_WORDS": "mccd", "COMP_CWORD": "x"}, {"COMP_WORDS": "mccd 'a"}])
def test_a_variable_of_completion_that_no_shell_has_set_is_a_usage_error(beside: dict[str, str]) -> None:
    clean = {name: value for name, value in os.environ.items() if not name.startswith("COMP_")}
    done = subprocess.run(
        [sys.executable, "-m", "mccdcli"],
        capture_output=True,
        text=True,
        timeout=60,
        env=clean | {"_MCCD_COMPLETE": "bash_complete"} | beside,
    )
    assert done.returncode == 2, done.stderr
    assert "unset it" in done.stderr


def test_completion_offers_names_and_options() -> None:
    def offered(words: str, index: int) -> set[str]:
        environment = {"_MCCD_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(index)}
        done = subprocess.run(
            [sys.executable, "-m", "mccdcli"],
            capture_output=True,
            text=True,
            timeout=60,
            env=os.environ | environment,
        )
        return {line.partition(",")[2] for line in done.stdout.splitlines()}

    assert offered("mccd comp", 1) == {"compare", "completion"}
    assert offered("mccd --", 1) == {"--help", "--version"}
    assert offered("mccd completion z", 2) == {"zsh"}


@pytest.mark.parametrize(("name", "entry"), COMMANDS.items())
def test_each_line_of_the_table_leads_to_a_command_that_explains_itself(name: str, entry: Entry) -> None:
    ctx, command = click.Context(cli), cli
    for word in name.split():
        assert isinstance(command, LazyGroup)
        command = command.get_command(ctx, word)  # type: ignore[assignment]
    assert isinstance(command, click.Command)
    assert command.name == name.split()[-1]
    assert command.help is not None
    assert " ".join(command.help.partition("\n\n")[0].split()) == entry.help
    shown = [line.strip() for line in CliRunner().invoke(command, ["--help"]).output.splitlines()]
    examples = shown[shown.index("Examples:") + 1 : shown.index("Options:")]
    assert any(line.startswith(f"mccd {name}") for line in examples)


def test_every_group_has_a_line_of_help_and_a_command() -> None:
    used = {name.partition(" ")[0] for name in COMMANDS if " " in name}
    assert used == set(GROUPS)
    assert not used & set(COMMANDS)


@pytest.fixture
def tree() -> LazyGroup:
    entries = {
        "chop": Entry("no_such_module:chop", "Chop."),
        "log show": Entry("no_such_module:show", "Show a log."),
        "log verify": Entry("no_such_module:verify", "Verify a log."),
    }
    return LazyGroup("mccd", entries, {"log": "Look at logs."}, help="Root.")


def test_help_lists_groups_and_commands_that_cannot_be_imported(tree: LazyGroup) -> None:
    root = CliRunner().invoke(tree, ["--help"]).output
    assert root.index("chop  Chop.") < root.index("log   Look at logs.")
    assert "show" not in root
    nested = CliRunner().invoke(tree, ["log", "--help"]).output
    assert "Look at logs." in nested
    assert nested.index("show    Show a log.") < nested.index("verify  Verify a log.")


def test_a_mistyped_name_is_answered_with_the_nearest_ones(tree: LazyGroup) -> None:
    for arguments, suggestion in (
        [["chpo"], "'chop'"],
        [["lgo", "show"], "'log'"],
        [["log", "vrify"], "'verify'"],
    ):
        done = CliRunner().invoke(tree, arguments)
        assert done.exit_code == 2
        assert f"Did you mean {suggestion}?" in done.output


def test_a_name_like_no_other_is_refused_without_a_suggestion(tree: LazyGroup) -> None:
    done = CliRunner().invoke(tree, ["zzzzzz"])
    assert done.exit_code == 2
    assert "No such command 'zzzzzz'" in done.output
    assert "Did you mean" not in done.output
