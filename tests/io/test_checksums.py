"""A flipped bit in what a run has stored is noticed, or changes nothing of what is read."""

import random
import re

import h5py
import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.io.history import read_history
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.io.vtkhdf import Trajectory
from taichi_mps.problem import catalogue
from tests.support.recorded import recorded


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a run of five outputs."""
    scene = catalogue.build("slump", spacing=0.05, until=1.0)
    folder, _, recorder = recorded(tmp_path_factory.mktemp("checksums") / "run", scene, 4)
    recorder.finish("time")
    return folder


def outputs_of(path):
    """All that a run.h5 shows, as bytes."""
    shown = []
    for output in Trajectory(path).whole():
        s = output.snapshot()
        arrays = (s.time, s.spacing, s.x, s.u, s.p, s.shear_rate, s.yielded, s.density_ratio, s.wall_x, s.size, s.mix)
        shown += [np.asarray(array).astype(float).tobytes() for array in arrays]
        shown += [repr(output.scene.parameters)]
    return shown


def columns_of(path):
    return {name: values.tobytes() for name, values in read_history(path).items()}


def damages(path, read, places):
    """How many flips of a bit at these places are noticed and named; each other one must leave what is read alike."""
    whole, right, noticed = path.read_bytes(), read(path), 0
    dice = random.Random(1)
    try:
        for place in places:
            flipped = bytearray(whole)
            flipped[place] ^= 1 << dice.randrange(8)
            path.write_bytes(flipped)
            try:
                assert read(path) == right, f"byte {place} of {path.name} is shown as a result"
            except mps.SceneError as error:
                assert path.name in str(error) or "run.h5" in str(error) or "summary" in str(error), error
                noticed += 1
    finally:
        path.write_bytes(whole)
    return noticed


def test_stored_values_of_run_h5(folder):
    """Bits of stored numbers: every one is noticed."""
    places, dice = [], random.Random(2)
    with h5py.File(folder.trajectory) as file:
        names = ["VTKHDF/Points", *(f"VTKHDF/PointData/{name}" for name in file["VTKHDF/PointData"])]
        for name in [*names, "VTKHDF/Steps/Values", "taichi_mps/crc32"]:
            data = file[name]
            for k in range(data.id.get_num_chunks()):
                chunk = data.id.get_chunk_info(k)
                rows = min(data.chunks[0], data.shape[0] - chunk.chunk_offset[0])
                size = rows * data.dtype.itemsize * int(np.prod(data.shape[1:]))
                places += [chunk.byte_offset + dice.randrange(size) for _ in range(20)]
    assert len(places) >= 160
    assert damages(folder.trajectory, outputs_of, places) == len(places)


def test_any_byte_of_run_h5(folder):
    size = folder.trajectory.stat().st_size
    places = random.Random(3).sample(range(size), 300)
    assert damages(folder.trajectory, outputs_of, places) > 0  # the others change nothing that is read


def test_every_byte_of_the_history(folder):
    size = folder.history.stat().st_size
    assert damages(folder.history, columns_of, range(size)) == size


def test_every_byte_of_the_summary(folder):
    def read(path):
        return repr(RunFolder(path.parent).read_summary())

    size = folder.summary.stat().st_size
    assert damages(folder.summary, read, range(size)) > 0.8 * size  # the others are blanks


@pytest.mark.parametrize("name", ["history.csv", "run.h5", "summary.json"])
def test_info_looks_at_all_files(folder, name):
    folder.verify()
    path = folder.path / name
    whole = path.read_bytes()
    try:
        path.write_bytes(whole[: len(whole) // 2] + bytes([whole[len(whole) // 2] ^ 1]) + whole[len(whole) // 2 + 1 :])
        if name != "run.h5" or outputs_differ(path):
            with pytest.raises(mps.SceneError):
                folder.verify()
    finally:
        path.write_bytes(whole)


def outputs_differ(path):
    try:
        return outputs_of(path) and False
    except mps.SceneError:
        return True


def test_what_was_cut_off_by_the_end_of_a_process_is_no_damage(folder):
    whole, rows = folder.history.read_bytes(), len(read_history(folder.history)["time_s"])
    last = whole[:-1].rfind(b"\n") + 1
    try:
        for end in range(last, len(whole)):
            folder.history.write_bytes(whole[:end])
            assert len(read_history(folder.history)["time_s"]) == rows - 1
    finally:
        folder.history.write_bytes(whole)


def test_files_of_a_version_without_checksums_are_read(folder, tmp_path):
    old = RunFolder(tmp_path)
    lines = folder.history.read_text().splitlines()
    old.history.write_text("".join(line.rpartition(",")[0] + "\r\n" for line in lines))
    assert columns_of(old.history) == columns_of(folder.history)
    old.trajectory.write_bytes(folder.trajectory.read_bytes())
    with h5py.File(old.trajectory, "r+") as file:
        del file["taichi_mps"]["crc32"], file["taichi_mps"].attrs["crc32"]
    assert outputs_of(old.trajectory) == outputs_of(folder.trajectory)
    assert Trajectory(old.trajectory).cut(1.0, 0.01) == 5
    with h5py.File(old.trajectory) as file:
        assert len(file["taichi_mps/crc32"]) == 5
    assert outputs_of(old.trajectory) == outputs_of(folder.trajectory)


def test_a_type_that_nothing_has_is_named_before_a_resumed_run_writes_on(tmp_path, folder):
    """The bias of the exponent in the type of each array of f32, as HDF5 stores it."""
    f32 = bytes.fromhex("11201f0004000000000020001708001 77f000000".replace(" ", ""))
    whole = folder.trajectory.read_bytes()
    places = [match.start() + len(f32) - 4 for match in re.finditer(re.escape(f32), whole)]
    assert len(places) >= 4
    for place in places:
        damaged = bytearray(whole)
        damaged[place + 3] ^= 0x40
        (tmp_path / "run.h5").write_bytes(damaged)
        with pytest.raises(mps.SceneError, match="run.h5: damaged"):
            Trajectory(tmp_path / "run.h5").cut(0.5, 0.1)
        assert (tmp_path / "run.h5").read_bytes() == bytes(damaged), "and left as it is"
