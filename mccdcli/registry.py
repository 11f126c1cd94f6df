"""Every command of `mccd` with its line of help: the one list, read without importing any of them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple


class Entry(NamedTuple):
    """Where a command lives (`module:attribute`) and its one line of help."""

    target: str
    help: str


# A name of two words ("log show") is a command in a group; the group needs a line in GROUPS.
GROUPS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "challenge": "Hide effects in simulated campaigns, and score how they are named.",
        "bench": "List benches.",
        "campaign": "Run, list and show whole campaigns.",
        "log": "Show, verify and recover logs.",
    }
)

COMMANDS: Final[Mapping[str, Entry]] = MappingProxyType(
    {
        "bench list": Entry("mccdcli.commands.bench_list:list_benches", "List the benches that a test can run on."),
        "campaign list": Entry(
            "mccdcli.commands.campaign_list:list_campaigns",
            "List the bundled campaigns, or the plans they are made of.",
        ),
        "campaign run": Entry("mccdcli.commands.campaign_run:run", "Play a whole campaign into a folder; resumable."),
        "campaign show": Entry(
            "mccdcli.commands.campaign_show:show", "Show a campaign's runs, or how far one in a folder has come."
        ),
        "chop": Entry("mccdcli.commands.chop:chop", "Chop between two positions: stability, repeatability, accuracy."),
        "diagnose": Entry(
            "mccdcli.commands.diagnose:diagnose", "Show what a model gets wrong, why, and what correcting it gains."
        ),
        "endstops": Entry("mccdcli.commands.endstops:endstops", "Measure the sensors' noise against the end stops."),
        "hysteresis": Entry(
            "mccdcli.commands.hysteresis:hysteresis", "Drive slow loops and steps at offsets: hysteresis."
        ),
        "identify": Entry(
            "mccdcli.commands.identify:identify", "Identify a linear model, from a sweep or from any logs."
        ),
        "report": Entry(
            "mccdcli.commands.report:report",
            "Run what is missing of a campaign and build its report beside the paper's numbers.",
        ),
        "settle": Entry(
            "mccdcli.commands.settle:settle", "Chop at 5 Hz under a control strategy: settling, power, current."
        ),
        "simulate": Entry("mccdcli.commands.simulate:simulate", "Play a plan or a waveform on a model and log it."),
        "theodolite": Entry(
            "mccdcli.commands.theodolite:theodolite", "Compare the angle sensors with a theodolite: gain corrections."
        ),
        "thermal": Entry(
            "mccdcli.commands.thermal:thermal", "Chop for five minutes and sweep at two temperatures: drift."
        ),
        "challenge make": Entry(
            "mccdcli.commands.challenge_make:make",
            "Make blind cases: logs of benches with hidden effects, their truth sealed apart.",
        ),
        "completion": Entry(
            "mccdcli.commands.completion:completion", "Print the script that completes mccd in your shell."
        ),
        "import": Entry(
            "mccdcli.commands.import_data:import_data",
            "Import data of any bench into a log, as a map file describes them.",
        ),
        "log recover": Entry(
            "mccdcli.commands.log_recover:recover",
            "Recover what a crash left of a log into a new file, marked as crashed.",
        ),
        "log show": Entry(
            "mccdcli.commands.log_show:show",
            "Show what a log holds: its run, its channels and its segments.",
        ),
        "log verify": Entry(
            "mccdcli.commands.log_verify:verify",
            "Verify that logs are as they were written; exit code 1 if one is not.",
        ),
    }
)
