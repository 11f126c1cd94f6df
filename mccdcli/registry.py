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
        "config": "Show what is set, and by what.",
        "challenge": "Hide effects in simulated campaigns, and score how they are named.",
        "bench": "List, serve and check benches.",
        "campaign": "Run, list and show whole campaigns.",
        "log": "List, show, draw, check, summarise, verify, export and recover logs.",
        "model": "Convert models, and list the effects that they can hold.",
    }
)

COMMANDS: Final[Mapping[str, Entry]] = MappingProxyType(
    {
        "bench list": Entry(
            "mccdcli.commands.bench_list:list_benches",
            "List the benches that --bench can name, and the models that a simulated one can run.",
        ),
        "config show": Entry(
            "mccdcli.commands.config_show:show",
            "Show what every option of COMMAND is set to and by what: default, file, environment or option.",
        ),
        "manual": Entry(
            "mccdcli.commands.manual:manual", "Print the manual: every command with its options and examples."
        ),
        "schema": Entry(
            "mccdcli.commands.schema:schema",
            "Print the JSON Schema of what COMMAND prints with --json, every value described.",
        ),
        "watch": Entry(
            "mccdcli.commands.watch:watch",
            "Watch a run while it is recorded: angles, residual against a model, status, time left.",
        ),
        "campaign list": Entry(
            "mccdcli.commands.campaign_list:list_campaigns",
            "List the campaigns that come with mccd, or the plans that campaigns are made of.",
        ),
        "campaign run": Entry(
            "mccdcli.commands.campaign_run:run",
            "Play every run of CAMPAIGN, a file or the name of a bundled one, each into a log of its own.",
        ),
        "campaign show": Entry(
            "mccdcli.commands.campaign_show:show",
            "Show the runs of CAMPAIGN with their settings, or how far the campaign in FOLDER has come.",
        ),
        "chop": Entry(
            "mccdcli.commands.chop:chop",
            "Chop between two positions and measure stability, repeatability and accuracy at both.",
        ),
        "compare": Entry(
            "mccdcli.commands.compare:compare",
            "Compare two logs, models or diagnoses: a table, and with --out a page with plots over each other.",
        ),
        "design": Entry(
            "mccdcli.commands.design:design",
            "Design feed-forward, feedback and learning on an identified model, against the noise of the bench at "
            "rest.",
        ),
        "diagnose": Entry(
            "mccdcli.commands.diagnose:diagnose",
            "Compare logs with a model: is it right, what is it missing, how sure is that, and what does adding it "
            "gain?",
        ),
        "endstops": Entry(
            "mccdcli.commands.endstops:endstops",
            "Pull the mechanism against its end stops in eight directions and measure the sensors' noise there.",
        ),
        "hysteresis": Entry(
            "mccdcli.commands.hysteresis:hysteresis",
            "Drive slow sine loops and fed-forward steps at offsets, open loop, and measure the hysteresis.",
        ),
        "identify": Entry(
            "mccdcli.commands.identify:identify",
            "Sweep every axis with a stepped sine and fit a linear model, or fit one to the logs of any bench.",
        ),
        "investigate": Entry(
            "mccdcli.commands.investigate:investigate",
            "Find out what a model gets wrong about a bench: run, diagnose, choose the next experiment, run on.",
        ),
        "report": Entry(
            "mccdcli.commands.report:report",
            "Run what is missing of a campaign, then build its report: every table and figure beside the paper's.",
        ),
        "settle": Entry(
            "mccdcli.commands.settle:settle",
            "Chop at 5 Hz and measure how fast each move settles to ±1.7 µrad, with power and peak current.",
        ),
        "simulate": Entry(
            "mccdcli.commands.simulate:simulate",
            "Play a plan, or a waveform of your own, on any model, and log what its bench measures.",
        ),
        "theodolite": Entry(
            "mccdcli.commands.theodolite:theodolite",
            "Hold a grid of angles and compare the sensors with a theodolite: gain corrections of both axes.",
        ),
        "study": Entry(
            "mccdcli.commands.study:study",
            "Try the same test many times, over drawn and swept models, strategies and settings.",
        ),
        "thermal": Entry(
            "mccdcli.commands.thermal:thermal",
            "Chop at 5 Hz for five minutes and look for drift; sweep both axes at two temperatures and compare.",
        ),
        "challenge make": Entry(
            "mccdcli.commands.challenge_make:make",
            "Make blind cases: logs of benches with hidden effects in DIR/cases, the sealed truth in DIR/truth.",
        ),
        "challenge run": Entry(
            "mccdcli.commands.challenge_run:run", "Diagnose every case of a challenge that has no result yet."
        ),
        "challenge score": Entry(
            "mccdcli.commands.challenge_score:score",
            "Reveal the truth of a challenge, check its seal, and score the diagnoses.",
        ),
        "challenge pool": Entry("mccdcli.commands.challenge_pool:pool", "Make one score of several."),
        "bench check": Entry(
            "mccdcli.commands.bench_check:check",
            "Check that a bench keeps to the serial protocol; exit code 1 if it does not.",
        ),
        "bench serve": Entry(
            "mccdcli.commands.bench_serve:serve",
            "Serve an emulated bench at a pseudo-terminal or a TCP port.",
        ),
        "completion": Entry(
            "mccdcli.commands.completion:completion", "Print the script that completes mccd in your shell."
        ),
        "import": Entry(
            "mccdcli.commands.import_data:import_data",
            "Import data of any bench into a log, as a map file describes them.",
        ),
        "log check": Entry(
            "mccdcli.commands.log_check:check",
            "Check what a log shows about itself: sizes, units, periods, dead channels, slow sensors, steps, clipping.",
        ),
        "log export": Entry(
            "mccdcli.commands.log_export:export",
            "Export a log for other programs, with units, times and segments where the format can hold them.",
        ),
        "model convert": Entry(
            "mccdcli.commands.model_convert:convert", "Convert a model between TOML and JSON, checked on the way."
        ),
        "model effects": Entry(
            "mccdcli.commands.model_effects:effects",
            "List the effects that a diagnosis can name and a model can hold, or describe one with its parameters.",
        ),
        "log list": Entry(
            "mccdcli.commands.log_list:list_logs",
            "List the logs in DIR and below: test, bench, start, status, note.",
        ),
        "log plot": Entry(
            "mccdcli.commands.log_plot:plot",
            "Draw every channel of a log over time: a picture with --out (.png, .svg, .pdf), else in the terminal.",
        ),
        "log recover": Entry(
            "mccdcli.commands.log_recover:recover",
            "Recover what a crash left of a log into a new file, marked as crashed.",
        ),
        "log show": Entry(
            "mccdcli.commands.log_show:show",
            "Show what a log holds: its run, its channels with their sizes, its segments.",
        ),
        "log summary": Entry(
            "mccdcli.commands.log_summary:summary",
            "Summarise every channel of a log: smallest and largest value, mean and standard deviation.",
        ),
        "log verify": Entry(
            "mccdcli.commands.log_verify:verify",
            "Verify that logs are as they were written; exit code 1 if one is not.",
        ),
    }
)
