"""A flipped bit in run.h5 or summary.json is reported, or shows nothing; a damaged history is refused."""

import random

import h5py
import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.io.history import read_history
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.io.vtkhdf import Trajectory
from tests.support.recorded import recorded

SCENE = mps.catalogue.build("slump", spacing=0.05, until=1.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a run of five outputs."""
    return recorded(tmp_path_factory.mktemp("checksums") / "run", 4, "time")[0]


def shown(path):
    """All that a file shows: of a run.h5 its origin and the arrays of its outputs, as bytes."""
    if path.name == "summary.json":
        return repr(RunFolder(path.parent).read_summary())
    states = [output.state for output in Trajectory(path).replay(scene=SCENE)]
    arrays = [
        (s.time, s.spacing, s.wall_x, *(getattr(s, name) for name in ("x", "u", *mps.measure.SCALARS))) for s in states
    ]
    return Trajectory(path).origin(), [np.asarray(array).astype(float).tobytes() for row in arrays for array in row]


def damages(path, read, places, noise=0):
    """How many flips of a bit at these places, or so many bytes of noise from there, are noticed and named; each other
    one must leave what is read alike."""
    whole, right, noticed = path.read_bytes(), read(path), 0
    dice = random.Random(1)
    try:
        for place in places:
            flipped = bytearray(whole)
            flipped[place] ^= 1 << dice.randrange(8)
            flipped[place : place + noise] = dice.randbytes(noise)
            path.write_bytes(flipped)
            try:
                assert read(path) == right, f"byte {place} of {path.name} is shown as a result"
            except mps.SceneError as error:
                assert "run.h5" in str(error) or "summary" in str(error), error
                noticed += 1
    finally:
        path.write_bytes(whole)
    return noticed


def stored_places(path):
    """3 places in each chunk of the stored arrays, and 20 in the text of the parameters."""
    dice, start = random.Random(2), path.read_bytes().index(b'{"density"')
    places = [start + dice.randrange(100) for _ in range(20)]
    with h5py.File(path) as file:
        names = ["VTKHDF/Points", *(f"VTKHDF/PointData/{name}" for name in file["VTKHDF/PointData"])]
        for data in (file[name] for name in [*names, "VTKHDF/Steps/Values"]):
            chunks = [data.id.get_chunk_info(k) for k in range(data.id.get_num_chunks())]
            for chunk in chunks:
                rows = min(data.chunks[0], data.shape[0] - chunk.chunk_offset[0])
                size = rows * data.dtype.itemsize * int(np.prod(data.shape[1:]))
                places += [chunk.byte_offset + dice.randrange(size) for _ in range(3)]
    assert len(places) >= 90
    return places


@pytest.mark.parametrize("noise", [0, 64])
@pytest.mark.parametrize(
    ("name", "places", "least"),
    [
        ("run.h5", stored_places, 1.0),
        ("run.h5", lambda path: random.Random(3).sample(range(path.stat().st_size), 75), 1 / 75),  # others show nothing
        ("summary.json", lambda path: range(path.stat().st_size), 0.8),  # some are blanks
    ],
)
def test_every_stored_value_is_guarded(folder, name, places, least, noise):
    path = folder.path / name
    chosen = list(places(path))[:: 9 if noise else 1]
    assert damages(path, shown, chosen, noise) >= least * len(chosen)


def test_a_history_with_another_number_of_cells_is_refused(tmp_path, folder):
    names, *rows = folder.history.read_text(encoding="utf-8").splitlines()
    for text, message in (("\n".join([names, rows[0], rows[1] + ",1", ""]), "row 2 has another"), ("", "no history")):
        (tmp_path / "history.csv").write_text(text, encoding="utf-8")
        with pytest.raises(mps.SceneError, match=message):
            read_history(tmp_path / "history.csv")


def test_what_was_cut_off_by_the_end_of_a_process_is_no_damage(folder):
    whole, rows = folder.history.read_bytes(), len(read_history(folder.history)["time_s"])
    last = whole[:-1].rfind(b"\n") + 1
    try:
        for end in range(last, len(whole)):
            folder.history.write_bytes(whole[:end])
            assert len(read_history(folder.history)["time_s"]) == rows - 1
    finally:
        folder.history.write_bytes(whole)


def test_damage_is_named_before_a_resumed_run_writes_on(tmp_path, folder):
    damaged, copy = bytearray(folder.trajectory.read_bytes()), tmp_path / "run.h5"
    damaged[stored_places(folder.trajectory)[-1]] ^= 0x40
    copy.write_bytes(damaged)
    with pytest.raises(mps.SceneError, match="run.h5: damaged"):
        Trajectory(copy).cut(0.5, 0.1)
    assert copy.read_bytes() == bytes(damaged) and list(tmp_path.iterdir()) == [copy], "it is left as it is"
