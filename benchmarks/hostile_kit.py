"""The small sound files of every kind that a hostile case begins with."""

from __future__ import annotations

import json
import os
import shutil
from functools import partial
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from benchmarks.hostile_cases import KERNELS, PLAYS
from benchmarks.hostile_child import LIMIT_S, in_child
from mccdcli.main import main as mccd

STUDY = """schema = "mccd-study/1"
name = "tiny"
kind = "endstops"
trials = 2
seed = 1
settings = { ramp_s = 0.02, settle_s = 0.02, hold_s = 0.05 }
limits = { noise_3sigma_m = 4e-8 }
[[vary]]
place = "model.modes[*].frequency_hz"
relative = true
normal = { std = 0.002 }
[[vary]]
place = "settings.current_a"
sweep = [ 4.0, 6.0 ]
"""
CAMPAIGN = """name = "small"
title = "a small one"
[[runs]]
name = "rest"
plan = "rest"
settings = { duration_s = 0.1, settle_s = 0.05 }
[[runs]]
name = "chop"
plan = "chop"
settings = { cycles = 2, frequency_hz = 5.0, window_s = 0.05, strategy = "mbff" }
"""
MAP = """[log]
test = "free-run"
source = "data.csv"
sample_rate_hz = 10.0
[channels.x]
select = "x"
unit = "mrad"
role = "output"
dof = "z"
[channels.u]
select = "u"
unit = "N"
role = "input"
dof = "z"
[segments]
"held-out" = [ 5, 20 ]
"""
SOUND: tuple[tuple[str, ...], ...] = (
    ("simulate", "--plan", "rest", "--set", "duration_s=0.2", "--set", "settle_s=0.1", "-o", "rest.h5"),
    ("simulate", "--model", "design", "--plan", "multisine", "--set", "period_s=0.05", "--set", "start_hz=20", "--set",
     "realisations=1", "-o", "run.h5"),
    ("model", "convert", "as-built", "-o", "model.toml"),
    ("model", "convert", "design-4th-order", "-o", "nominal.toml"),
    ("campaign", "run", "campaign.toml", "-o", "played"),
    ("study", "study.toml", "-o", "studied", "--workers", "1"),
    ("design", "--model", "design", "--unswept", "-o", "designed"),
    ("challenge", "make", "hidden", "--one", "0", "--none", "1", "--shape", "short"),
)  # fmt: skip
"""What makes the sound files."""


def make_kit(folder: Path) -> None:
    """Make a folder of small sound files of every kind that commands read, and some that are none.

    Beside it is the folder of the commands' temporary files.
    """
    # compiled code and the list of fonts are those of whoever runs this, whatever home a case has
    for name, kept in (("MCCD_KERNEL_CACHE", "kernels"), ("MPLCONFIGDIR", "matplotlib")):
        os.environ.setdefault(name, str(user_cache_path("mccd", appauthor=False) / kept))
    folder.mkdir(parents=True)
    (folder.parent / "tmp").mkdir()
    for name, text in (("study.toml", STUDY), ("campaign.toml", CAMPAIGN), ("map.toml", MAP)):
        (folder / name).write_text(text, encoding="utf-8")
    rows = "".join(f"{0.1 * i:.1f},{i % 7},{i % 5 - 2}\n" for i in range(40))
    (folder / "data.csv").write_text("t,x,u\n" + rows, encoding="utf-8")
    (folder / "wave.csv").write_text("theta_x,z\n" + "0.001,0.0\n0.0,0.01\n" * 50, encoding="utf-8")
    (folder / "readings.csv").write_text("theta_x,theta_y\n" + "0.001,0.0\n" * 13, encoding="utf-8")
    curve = "".join(f"{10 * i},{1 / (1 + i * i)},{-3 * i}\n" for i in range(1, 30))
    (folder / "response.csv").write_text("frequency_hz,magnitude,phase_deg\n" + curve, encoding="utf-8")
    u, x = np.arange(40) % 5 - 2.0, np.arange(40) % 7 / 7.0
    np.savez(folder / "data.npz", u=u, x=x)
    np.save(folder / "data.npy", np.stack([u, x], axis=1))
    (folder / "map-npz.toml").write_text(MAP.replace("data.csv", "data.npz"), encoding="utf-8")
    columns = MAP.replace("data.csv", "data.npy").replace('"x"\nunit', '"[:, 1]"\nunit').replace('"u"\n', '"[:, 0]"\n')
    (folder / "map-npy.toml").write_text(columns, encoding="utf-8")
    for arguments in SOUND:
        # nothing hostile yet: a sound design takes half a minute
        code, said = in_child(partial(mccd, list(arguments)), folder, 4 * LIMIT_S)
        if code:
            raise RuntimeError(f"{' '.join(arguments)} ends with {code}: {said}")
    results = folder / "hidden" / "results" / "0001"
    results.mkdir(parents=True)
    ended = {"case": "0001", "exit_code": 0, "wall_s": 1.0, "cpu_s": 1.0, "tool_version": "1", "tool_commit": "a"}
    (results / "run.json").write_text(json.dumps(ended), encoding="utf-8")
    cause = {"effect": "backlash", "where": "theta_x", "probability": 0.9, "parameters": {"gap": {"value": 1.0}}}
    answer = {"verdict": "named", "causes": [cause], "ambiguous": [], "gain": {"rms_after": 1.0}, "remainder": None}
    (results / "diagnosis.json").write_text(json.dumps(answer), encoding="utf-8")
    in_child(lambda: mccd(["challenge", "score", "hidden", "-o", "score.json"]), folder, LIMIT_S)
    (folder / "folder").mkdir()
    (folder / "empty").touch()
    (folder / "binary").write_bytes(bytes(range(256)) * 20)
    (folder / "long").write_bytes(b"x" * 1_000_000)
    (folder / "deep").write_bytes(b"a = " + b"[" * 100_000)
    (folder / "link").symlink_to("nowhere")
    (folder / "loop").symlink_to("loop")
    (folder / "unreadable").touch(mode=0)


def fill_kernels(kit: Path) -> None:
    """Fill a folder beside the kit with the compiled code that playing on a bench takes, and no other."""
    (kit.parent / KERNELS).mkdir()
    for arguments in PLAYS:
        scratch = kit.parent / "scratch"
        shutil.copytree(kit, scratch, symlinks=True)
        in_child(partial(mccd, list(arguments)), scratch, LIMIT_S)
        shutil.rmtree(scratch)
