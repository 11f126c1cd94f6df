"""A real small disk: a tmpfs in a mount namespace of its own, which needs no rights of the machine's owner.

A read-only file system refuses everybody, so these tests say the same whether they run as root or not.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

NOT_ALLOWED = 77


def on_small_disk(
    folder: Path, size: str, script: str, *arguments: str, timeout_s: float = 120.0
) -> subprocess.CompletedProcess[str]:
    """Run a shell `script` in `folder` as a disk of `size`; leave there what stood on it at the end.

    The script finds `arguments` as "$1", "$2" …. Skips the test where such a disk may not be made.
    """
    folder.mkdir()
    kept = folder.with_name(f"{folder.name}.kept")
    mounted = 'disk="$1"; kept="$2"; mount -t tmpfs -o size="$3" none "$disk" || exit 77; cd "$disk"; shift 3; '
    saved = '; code=$?; cd /; cp -a "$disk" "$kept"; exit $code'
    done = _in_namespace(f"{mounted}( {script} ){saved}", str(folder), str(kept), size, *arguments, timeout_s=timeout_s)
    folder.rmdir()
    kept.rename(folder)
    return done


def with_read_only(
    folder: Path, script: str, *arguments: str, timeout_s: float = 120.0
) -> subprocess.CompletedProcess[str]:
    """Run a shell `script` in `folder`, which is read-only meanwhile; as `on_small_disk`."""
    mounted = (
        'disk="$1"; mount --bind "$disk" "$disk" && mount -o remount,bind,ro "$disk" || exit 77; cd "$disk"; shift; '
    )
    return _in_namespace(mounted + script, str(folder), *arguments, timeout_s=timeout_s)


def _in_namespace(script: str, *arguments: str, timeout_s: float) -> subprocess.CompletedProcess[str]:
    command = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script, "sh", *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, stdin=subprocess.DEVNULL)
    except FileNotFoundError:
        pytest.skip("needs the command unshare to make a small disk")
    if done.returncode == NOT_ALLOWED or done.stderr.startswith("unshare:"):
        pytest.skip(f"may not make a small disk here: {done.stderr.strip()}")
    return done
