"""Maps and selections made of anything end in a log or in one clear line."""

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from campaigns.importing import import_run
from campaigns.importing.selecting import parse_selection
from sim_backend.errors import ConfigError, MccdError

MAP = """
[log]
test = "free-run"
source = "a.npz"
sample_rate_hz = 10.0
period = 4
axes = ["sample"]
[channels.x]
select = "u[:, 1]"
unit = "mrad"
role = "output"
dof = "z"
scale = 2.0
[segments]
"held-out" = [3, 9]
"""
PIECES = [
    "9e999",
    "-1",
    "0",
    "nan",
    "[",
    "]",
    '"',
    "\n",
    "\x00",
    "é",
    "sample",
    "period",
    "u[:, 9]",
    "{}",
    "true",
    "1" * 40,
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("fuzz")
    np.savez(made / "a.npz", u=np.random.default_rng(0).normal(size=(12, 2)))
    return made


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    edits=st.lists(
        st.tuples(st.integers(0, len(MAP)), st.integers(0, 12), st.sampled_from(PIECES) | st.text(max_size=5)),
        max_size=3,
    )
)
@example(edits=[])
def test_an_edited_map_imports_or_is_refused_in_one_line(folder, edits):
    text = MAP
    for start, removed, piece in edits:
        text = text[:start] + piece + text[start + removed :]
    (folder / "map.toml").write_bytes(text.encode("utf-8", "surrogatepass"))
    for name in ("out.h5", "out.h5.sha256"):
        (folder / name).unlink(missing_ok=True)
    try:
        report = import_run(folder / "map.toml", folder / "out.h5")
    except MccdError as error:
        assert "\n" not in str(error)
        assert not (folder / "out.h5").exists()
    else:
        assert 1 <= report.rows <= 12 and (folder / "out.h5").exists()
    if not edits:
        assert report.rows == 12


@given(st.text(max_size=30) | st.text(alphabet="u[]:,.-0123456789 ", max_size=20))
def test_any_text_is_a_selection_or_a_clear_error(text):
    try:
        parse_selection(text)
    except ConfigError as error:
        assert text in str(error)


bound = st.none() | st.integers(-7, 7)
index = st.integers(-3, 2) | st.builds(slice, bound, bound, st.none() | st.integers(-3, 3).filter(bool)) | st.just(...)


def written(part: object) -> str:
    if isinstance(part, slice):
        return ":".join("" if value is None else str(value) for value in (part.start, part.stop, part.step))
    return "..." if part is ... else str(part)


@given(st.lists(index, min_size=1, max_size=3).filter(lambda parts: parts.count(...) <= 1))
def test_indices_mean_what_numpy_means(parts):
    array = np.arange(3 * 4 * 5).reshape(3, 4, 5)
    selection = parse_selection(f"u[{', '.join(written(part) for part in parts)}]")
    assert selection.name == "u"
    np.testing.assert_array_equal(array[selection.indices], array[tuple(parts)])
