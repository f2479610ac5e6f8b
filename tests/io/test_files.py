"""Run folder, history, VTKHDF trajectory and checkpoints, with a stand-in for the simulation: no Taichi here."""

import json
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import h5py
import imageio.v3 as iio
import meshio
import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.simulation.frame import Frame
from taichi_mps.io import checkpoint, vtkhdf
from taichi_mps.io import vtu as export
from taichi_mps.io.history import COLUMNS, History, read_history
from taichi_mps.io.recorder import Recorder
from taichi_mps.io.run_folder import RunFolder, clear_pictures, next_free
from taichi_mps.io.vtkhdf import Trajectory
from taichi_mps.report.drawings import film_of_grains
from taichi_mps.viz import film
from taichi_mps.viz.body import smooth_surface
from tests.support.child import child
from tests.support.recorded import Falling, recorded


@pytest.fixture
def slump():
    return mps.catalogue.build("slump", spacing=0.05, until=1.0)


@pytest.fixture
def run(tmp_path):
    """A run of 3 steps of 0.01 s, each an output."""
    folder, sim, recorder = recorded(tmp_path / "run", 3)
    return SimpleNamespace(folder=folder, sim=sim, recorder=recorder, trajectory=recorder.trajectory)


def times(trajectory):
    return pytest.approx([output.time for output in trajectory.replay()])


@pytest.fixture
def plane():
    """A two-dimensional square."""
    return mps.Scene(
        name="plane",
        material=mps.Bingham(),
        spacing=0.1,
        fluid=mps.fill(mps.Box((0.0, 0.0), (0.4, 0.4)), 0.1),
        domain=((-1.0, -1.0), (1.0, 1.0)),
        measure=mps.measure.front,
    )


@pytest.mark.parametrize(("stopped_by", "error"), [("interrupted", None), ("diverged", "too fast")])
def test_summary_is_strict_json_and_names_the_checkpoint(run, stopped_by, error):
    """After a divergence the summary names the checkpoint of the last good output; results over time are those of
    history.csv."""
    run.sim.time = 99.0 if error else run.sim.time
    run.sim.scene = replace(run.sim.scene, over_time=lambda history: {"rows_number": float(len(history["time_s"]))})
    run.recorder.finish(stopped_by, error)
    summary = json.loads(run.folder.summary.read_text(), parse_constant=pytest.fail)
    assert (summary["volume_error"], summary["stopped_by"], summary.get("error")) == (None, stopped_by, error)
    assert (summary["resume_from"], summary["rows_number"]) == (str(run.folder.checkpoint), 4.0)
    assert checkpoint.read(run.folder.checkpoint).header["time"] == pytest.approx(0.03)


def test_trajectory_is_temporal_vtkhdf_polydata(run):
    n, firsts = len(run.sim.scene.fluid), np.arange(4) * len(run.sim.scene.fluid)
    known = {
        "Steps/Values": [0.0, 0.01, 0.02, 0.03],
        "Steps/PointOffsets": firsts,
        "NumberOfPoints": [n],
        "Steps/NumberOfParts": np.ones(4),
        "Steps/PartOffsets": np.zeros(4),
    }
    known |= dict.fromkeys(("Steps/CellOffsets", "Steps/ConnectivityIdOffsets"), np.zeros((4, 4)))
    for part, count in {"Vertices": n, "Lines": 0, "Strips": 0, "Polygons": 0}.items():
        known |= dict.fromkeys((f"{part}/NumberOfCells", f"{part}/NumberOfConnectivityIds"), [count])
        known |= {f"{part}/Connectivity": np.arange(count), f"{part}/Offsets": np.arange(count + 1)}
    fields = {"velocity", "pressure", "shear_rate", "yielded", "density_ratio"}
    known |= {f"Steps/PointDataOffsets/{name}": firsts for name in fields}
    with h5py.File(run.folder.trajectory) as file:
        root = file["VTKHDF"]
        assert root.attrs["Type"] == b"PolyData" and list(root.attrs["Version"]) == [2, 0]
        assert root["Steps"].attrs["NSteps"] == 4 and set(root["PointData"]) == fields
        assert root["Points"].shape == (4 * n, 3) and all(len(root["PointData"][name]) == 4 * n for name in fields)
        for name, values in known.items():
            np.testing.assert_allclose(root[name], values, err_msg=name)
        np.testing.assert_allclose(root["Points"][3 * n :], run.sim.snapshot().x, atol=1e-6)


def test_a_replay_and_a_report_have_the_grains_of_the_run(tmp_path):
    scene = mps.catalogue.build("slump", spacing=0.02, until=1.0)
    stones = mps.Grains(diameter=[(0.08, 0.25), (0.1, 0.75)], volume_fraction=0.2, friction=0.2, seed=3)
    sim, trajectory = Falling(replace(scene, grains=stones)), Trajectory(tmp_path / "run.h5")
    now = replace(sim.snapshot(), grain=sim.scene.grain_places[0])
    sim.snapshot = lambda: now
    trajectory.create(sim, "slump", 0.01)
    trajectory.append(now)
    (output,) = trajectory.replay()
    np.testing.assert_array_equal(output.scene.grain_places[0], output.snapshot().grain)
    shown = film_of_grains(output.scene, [output.snapshot()], np.zeros(3), np.full(3, 1e-4))
    assert (shown["sizes"], len(shown["radii"])) == ([80.0, 100.0], len(sim.scene.grain_places[1]))
    assert shown["free"] == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("model", ["full", "axisymmetric"])
def test_a_replay_gives_snapshots_and_measures_back(tmp_path, model):
    """Of rings run.h5 keeps the section and the sizes, and replayed slump and spread are those of the revolved body."""
    sim = Falling(mps.catalogue.build("slump", spacing=0.02, model=model, until=1.0))
    sizes = np.linspace(0.01 if model == "axisymmetric" else 0.02, 0.02, len(sim.scene.fluid))
    trajectory = Trajectory(tmp_path / "run.h5")
    trajectory.create(sim, "slump", 0.01)
    with pytest.raises(mps.SceneError, match="run.h5 holds no output yet"):
        trajectory.checked_replay()
    sim.time = 0.1
    now = replace(sim.snapshot(), size=sizes)
    trajectory.append(now)
    (output,) = trajectory.replay()
    for name in ("x", "u", "yielded", "size", "mix"):
        np.testing.assert_allclose(getattr(output.snapshot(), name), getattr(now, name), atol=1e-6, err_msg=name)
    assert (output.scene.name, output.time) == ("slump", 0.1)
    known = sim.scene.measure(sim.scene.unfold(now))
    assert output.measures() == pytest.approx(known, rel=1e-3)  # rings are whole numbers of particles, rounded


@pytest.mark.parametrize(
    ("more", "cut", "left"),
    [
        ([0.03], (0.02, 0.01), [0.0, 0.01, 0.02]),  # written once, and later ones can be cut
        ([0.034], (0.034, 0.01), [0.0, 0.01, 0.02, 0.03]),  # that which only the interrupted end of the run made
        ([], (0.03, 0.02), [0.0, 0.01, 0.02, 0.03]),  # going on with another interval keeps them
    ],
)
def test_outputs_that_a_run_goes_on_from(run, more, cut, left):
    for time in more:
        run.sim.time = time
        assert run.trajectory.append(run.sim.snapshot()) == (4 if time > 0.03 else None)
    assert run.trajectory.cut(*cut) == len(left)
    assert times(run.trajectory) == left
    run.sim.time = 0.06
    assert run.trajectory.append(run.sim.snapshot()) == len(left)
    assert times(run.trajectory) == [*left, 0.06]
    run.sim.time = 0.07  # of the new interval 0.02 s no multiple
    run.trajectory.append(run.sim.snapshot())
    assert run.trajectory.cut(0.07, every=0.01) == len(left) + 1 + (cut[1] == 0.01)


def test_a_run_resumed_at_its_end_keeps_its_last_output_and_the_measures_of_its_last_step(tmp_path, slump):
    """A run resumed at its end keeps the measures of its last step, such as loads on walls, which are known after a
    step only."""
    folder, sim, recorder = recorded(tmp_path / "run", 3, scene=replace(slump, until=0.034))
    assert len(folder.history.read_text().splitlines()) >= 4, "rows must be on disk while the run goes on"
    sim.time = 0.034
    recorder.trajectory.append(sim.snapshot())
    (folder.frames / "frame_00004.png").write_text("the last")
    recorder.finish("time")
    last = read_history(folder.history)["slump_m"][-1]
    sim.measures = lambda: {"slump_m": float("nan")}
    again = Recorder(folder, sim, 0.01, "slump", {"every": 0.01})
    again.finish("time")
    assert times(again.trajectory) == [0.0, 0.01, 0.02, 0.03, 0.034]
    assert (folder.frames / "frame_00004.png").is_file()
    assert folder.read_summary()["slump_m"] == pytest.approx(last)


def test_without_run_h5_the_history_goes_on_and_pictures_are_not_mixed(run):
    run.recorder.finish("time")
    run.folder.trajectory.unlink()
    Recorder(run.folder, run.sim, 0.01, "slump", {}).finish("time")
    run.folder.trajectory.unlink()
    (run.folder.frames / "frame_00000.png").write_bytes(b"")
    with pytest.raises(mps.SceneError, match=r"run.h5 is gone.*move the pictures elsewhere"):
        Recorder(run.folder, run.sim, 0.01, "slump", {})
    assert read_history(run.folder.history)["time_s"] == pytest.approx([0.0, 0.01, 0.02, 0.03])


FULL_DISK = """
import resource, signal, sys
import numpy as np
from taichi_mps.io.checkpoint import Checkpoint
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    Checkpoint({}, {"x": np.zeros((300, 3))}).write(sys.argv[1])
except OSError as error:
    print(type(error).__name__)
"""


def test_a_full_disk_is_an_error_and_the_last_checkpoint_stays(tmp_path):
    """A full disk raises an error, although HDF5 itself would end the process where it cannot write on closing a
    file."""
    (tmp_path / "checkpoint.h5").write_bytes(b"the last one")
    assert child("-c", FULL_DISK, tmp_path / "checkpoint.h5").stdout == "OSError\n"
    assert (tmp_path / "checkpoint.h5").read_bytes() == b"the last one"


@pytest.mark.parametrize("links", [True, False])
def test_outputs_are_added_beside_run_h5_while_viewers_keep_it_open(run, monkeypatch, links):
    """A process killed during an output leaves run.h5 of the previous output bit for bit, also on a disk without links,
    and on a full one."""

    def refused(*_):
        raise OSError("no links here")

    path, opened, h5 = run.folder.trajectory, [], h5py.File
    if not links:
        monkeypatch.setattr(vtkhdf.os, "link", refused)
    with h5(path) as first:
        monkeypatch.setattr(h5py, "File", lambda name, *how, **more: opened.append(name) or h5(name, *how, **more))
        run.sim.step()
        with h5(path):
            run.sim.step()
        assert len(first["VTKHDF/Steps/Values"]) == 4 and opened and path not in opened
    assert times(run.trajectory) == [0.0, 0.01, 0.02, 0.03, 0.04, 0.05]
    monkeypatch.setattr(vtkhdf.shutil, "disk_usage", lambda path: SimpleNamespace(free=1000))
    with pytest.raises(OSError, match="No space left"):
        run.sim.step()
    assert times(run.trajectory) == [0.0, 0.01, 0.02, 0.03, 0.04, 0.05]
    run.recorder.finish("time")
    assert not list(run.folder.path.glob("*twin*"))


def test_vtk_reads_the_times_the_points_and_the_fields(run):
    """ParaView's reader gives back times, points and fields; ParaView 5.12 has that of VTK 9.3, so newer features are
    not tested."""
    hdf = pytest.importorskip("vtkmodules.vtkIOHDF", reason="vtk is not installed: pip install 'taichi-mps[vtk]'")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

    reader = hdf.vtkHDFReader()
    reader.SetFileName(str(run.folder.trajectory))
    reader.UpdateInformation()
    asked = reader.GetOutputInformation(0)
    assert asked.Get(Pipeline.TIME_STEPS()) == pytest.approx((0.0, 0.01, 0.02, 0.03))
    for output in run.trajectory.replay():
        asked.Set(Pipeline.UPDATE_TIME_STEP(), output.time)
        reader.Modified()
        reader.Update()
        found = reader.GetOutput()
        assert (found.GetNumberOfPoints(), found.GetNumberOfVerts()) == (len(output.state.x),) * 2
        known = {name: rows for name, rows in vtkhdf.point_data(output.state).items() if name not in ("size", "mix")}
        np.testing.assert_array_equal(vtk_to_numpy(found.GetPoints().GetData()), output.state.x.astype(np.float32))
        for name, values in known.items():
            np.testing.assert_array_equal(vtk_to_numpy(found.GetPointData().GetArray(name)), values)


def test_an_export_holds_every_output_with_its_time(tmp_path, plane):
    """An export of a plane scene lies at y = 0; a smooth surface has triangles, and is refused where there can be
    none."""
    _, sim, recorder = recorded(tmp_path / "run", 2, scene=plane)
    assert export.vtu(recorder.trajectory.replay(scene=plane), tmp_path / "vtu") == 3
    sets = ElementTree.parse(tmp_path / "vtu" / "run.pvd").getroot().findall("Collection/DataSet")
    assert [float(item.get("timestep")) for item in sets] == pytest.approx([0.0, 0.01, 0.02])
    mesh = meshio.read(tmp_path / "vtu" / sets[-1].get("file"))
    with pytest.raises(mps.SceneError, match="outputs: are none"):  # an earlier export is no other file
        export.vtu([], tmp_path / "vtu")
    with pytest.raises(mps.SceneError, match=r"out = .*run: holds other files, such as"):
        export.vtu([Frame(plane, sim.snapshot())], tmp_path / "run")
    for rows, known in ((mesh.points, sim.snapshot().x), (mesh.point_data["velocity"], sim.snapshot().u)):
        np.testing.assert_allclose(rows[:, [0, 2]], known, atol=1e-6)
        assert not rows[:, 1].any()
    assert mesh.cells[0].type == "vertex" and len(mesh.cells[0].data) == len(plane.fluid)
    body = mps.measure.still(mps.lattice((0.0, 0.0, 0.0), (0.4, 0.4, 0.4), 0.1), 0.1)
    assert export.vtu([Frame(plane, body)], tmp_path / "surface", smooth=True) == 1
    mesh = meshio.read(tmp_path / "surface" / "output_00000.vtu")
    assert mesh.cells[0].type == "triangle" and set(mesh.point_data) == set(vtkhdf.point_data(body))
    with pytest.raises(mps.SceneError, match="the body is .* cells long; must be at most 1e.06"):
        smooth_surface(mps.measure.still([(0.0, 0.0, 0.0), (1e30, 0.0, 0.0)], 0.1))


@pytest.mark.parametrize("model", ["full", "quarter", "axisymmetric"])
def test_the_surface_of_a_part_is_that_of_the_whole_body(model):
    """The surface of a part is closed around the volume of the paper's cone, with normals outward and the fields of the
    particles."""
    scene = mps.catalogue.build("slump", spacing=0.0125, model=model)
    x = scene.fluid
    part = replace(
        mps.measure.still(x, scene.spacing),
        p=3.0 - 2.0 * x[:, -1],
        shear_rate=np.full(len(x), 7.0),
        yielded=x[:, -1] > 0.15,
    )
    s, normals, triangles = smooth_surface(scene.unfold(part))
    corners = s.x[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    volume = np.einsum("ij,ij->", corners[:, 0], across) / 6.0
    whole = mps.catalogue.build("slump", spacing=0.0125)
    assert volume == pytest.approx(whole.volumes.sum(), rel=0.04)
    assert np.abs(across.sum(0)).max() < 1e-9  # closed
    assert np.einsum("ij,ij->i", normals[triangles].mean(1), across).min() > 0.0
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert np.abs(s.x[:, :2]).max(0) == pytest.approx(0.1, abs=0.6 * scene.spacing)  # of the base
    np.testing.assert_allclose(s.shear_rate, 7.0, rtol=1e-9)
    assert np.abs(s.p - (3.0 - 2.0 * s.x[:, 2])).max() < 2.0 * 1.5 * scene.spacing
    assert not s.yielded[s.x[:, 2] < 0.13].any() and s.yielded[s.x[:, 2] > 0.17].all()


@pytest.mark.parametrize(
    ("member", "damage"),
    [
        ("Points", lambda x: np.vstack([x[:-1], [[np.nan, 0.0, 0.0]]])),
        ("Points", lambda x: np.vstack([x[:-1], [[1e6, 0.0, 0.0]]])),
        ("Points", lambda x: np.vstack([x[:-1], [[0.0, -1e30, 0.0]]])),
        ("Points", lambda x: x[..., None]),
        ("Steps/Values", lambda times: np.nan * times),
        ("PointData/size", lambda pressure: 0.0 * pressure + 1e-9),
        ("PointData/pressure", lambda pressure: pressure[:, None]),
    ],
)
def test_a_run_with_damage_in_an_output_is_refused_before_anything_is_made_of_it(run, capsys, member, damage):
    """Damaged outputs, on which film, revolved body or painter would hang or exhaust memory, are refused before a file
    is written."""
    run.recorder.finish("time")
    with h5py.File(run.folder.trajectory, "r+") as file:
        root = file["VTKHDF"]
        rows = damage(root.get(member, root["PointData/pressure"])[()])
        root.pop(member, None)
        root[member] = rows
    before = sorted(run.folder.path.rglob("*"))
    for words in (["render"], ["export"], ["export", "--surface"]):
        assert mps.main([*words, str(run.folder.path)]) == 2
        assert "run.h5: damaged or not one of taichi_mps" in capsys.readouterr().err
    assert sorted(run.folder.path.rglob("*")) == before


def test_outputs_of_two_runs_are_matched_by_time():
    def run(times):
        return (SimpleNamespace(time=time) for time in times)

    pairs = [(a.time, b.time) for a, b in film.align_in_time(run([0.0, 0.1, 0.2]), run([0.0, 0.15, 0.2, 0.4]))]
    assert pairs == [(0.0, 0.0), (0.1, 0.0), (0.1, 0.15), (0.2, 0.2), (0.2, 0.4)]


def test_a_film_has_every_picture(tmp_path):
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed: pip install 'taichi-mps[film]'")
    for k in range(5):
        iio.imwrite(tmp_path / f"{k}.png", np.full((64, 96, 3), 40 * k, np.uint8))
    made = film.mp4([tmp_path / f"{k}.png" for k in range(5)], tmp_path / "film.mp4")
    shown = iio.imread(made, plugin="FFMPEG")
    assert shown.shape == (5, 64, 96, 3)
    assert np.abs(shown.mean((1, 2, 3)) - 40 * np.arange(5)).max() < 4


def row(time, **measures):
    return {**dict.fromkeys(COLUMNS, 0.0), "time_s": time, **measures}


def test_a_measure_that_fails_at_the_start_or_later_keeps_its_column(tmp_path):
    path = tmp_path / "history.csv"
    history = History(path)  # at 0 s it gave nothing
    for time, measures in ((0.0, {}), (0.1, {"front_m": 1.0}), (0.2, {}), (0.3, {"front_m": 2.0, "height_m": 3.0})):
        history.add(row(time, **measures))
    history.close()
    found = read_history(path)
    assert tuple(found) == (*COLUMNS, "front_m", "height_m")
    np.testing.assert_array_equal(found["front_m"], [np.nan, 1.0, np.nan, 2.0])
    np.testing.assert_array_equal(found["height_m"], [np.nan, np.nan, np.nan, 3.0])
    again = History(path, kept=0.2)  # resumed, where it fails
    again.add(row(0.3))
    again.close()
    np.testing.assert_array_equal(read_history(path)["front_m"], [np.nan, 1.0, np.nan, np.nan])


def test_the_row_of_the_checkpoint_is_kept_however_its_time_is_rounded(tmp_path):
    """The row of the checkpoint is kept although its time of nine digits is up to 5e-9 s off; the next step is farther
    away."""
    for time in (1.0000000049, 0.0458282506501, 0.3):
        history = History(tmp_path / "history.csv")
        history.add({"time_s": time})
        history.add({"time_s": time + 1e-6})
        history.close()
        History(tmp_path / "history.csv", kept=time).close()
        assert len(read_history(tmp_path / "history.csv")["time_s"]) == 1


def test_a_run_folder_from_elsewhere_names_no_code_to_run(tmp_path, run):
    trap = tmp_path / "trap.py"
    trap.write_text("raise SystemExit('this must not run')")
    run.recorder.finish("time")
    with h5py.File(run.folder.trajectory, "r+") as file:
        file["taichi_mps"].attrs["source"] = str(trap)
    with pytest.raises(mps.SceneError, match="trap.py: is code of yours, and run only if you name it again: --scene"):
        next(run.trajectory.replay())
    checkpoint.Checkpoint.of(run.sim, str(trap)).write(run.folder.checkpoint)
    with pytest.raises(mps.SceneError, match="trap.py: is code of yours"):
        checkpoint.read(run.folder.checkpoint).scene()


def test_an_old_run_is_replaced_but_foreign_files_stay(run):
    folder = run.folder
    with pytest.raises(mps.SceneError, match="holds a run already; 'taichi-mps resume .*run' goes on with it, --over"):
        folder.check()
    run.recorder.finish("time")
    (folder.frames / "frame_00000.png").write_bytes(b"old")
    (folder.frames / "holiday.png").write_bytes(b"mine")
    (folder.path / "notes.txt").write_text("mine")
    with pytest.raises(mps.SceneError, match="out = .*run: holds a run already; --overwrite replaces it"):
        folder.create()
    folder.create(overwrite=True)
    assert sorted(path.name for path in folder.path.iterdir()) == ["frames", "notes.txt", "taichi_mps.json"]
    assert [path.name for path in folder.frames.iterdir()] == ["holiday.png"]


@pytest.mark.parametrize("name", ["history.csv", "summary.json", "checkpoint.h5", "run.h5", "frames/frame_00001.png"])
@pytest.mark.parametrize("text", ["mine", '{"scene": "mine", "made_by": 3}'])
def test_a_file_of_somebody_with_a_name_of_ours_is_not_touched(tmp_path, name, text):
    theirs = tmp_path / name
    theirs.parent.mkdir(exist_ok=True)
    theirs.write_text(text)
    for path, message in (("", "holds other files and no run"), (name, "is a file"), (f"{name}/run", "cannot be wri")):
        with pytest.raises(mps.SceneError, match=f"out = .*{message}"):
            RunFolder(tmp_path / path).create(overwrite=True)
    assert theirs.read_text() == text
    assert [path.name for path in tmp_path.iterdir()] == [name.split("/")[0]]


def test_what_lies_behind_a_link_is_not_touched(tmp_path, run):
    run.recorder.finish("time")
    folder, album, diary = run.folder, tmp_path / "album", tmp_path / "diary.csv"
    diary.write_text("mine")
    folder.history.unlink()
    folder.history.symlink_to(diary)
    recorded(folder.path, 1, overwrite=True)
    assert not folder.history.is_symlink() and diary.read_text() == "mine"
    folder.frames.rmdir()
    album.mkdir()
    (album / "frame_00000.png").write_bytes(b"mine")
    folder.frames.symlink_to(album)
    with pytest.raises(mps.SceneError, match="its frames lie elsewhere"):
        folder.create(overwrite=True)
    with pytest.raises(mps.SceneError, match="is a link to another folder"):
        clear_pictures(folder.frames)
    assert (album / "frame_00000.png").read_bytes() == b"mine"


def test_the_next_free_name(tmp_path):
    assert next_free(tmp_path / "slump") == tmp_path / "slump"
    (tmp_path / "slump").mkdir()
    (tmp_path / "slump-2").symlink_to(tmp_path / "nowhere")
    assert next_free(tmp_path / "slump") == tmp_path / "slump-3"


def test_a_checkpoint_comes_back_bit_for_bit(tmp_path, slump):
    sim = Falling(slump)
    sim.time = 0.1 + 0.2
    checkpoint.save(sim, tmp_path / "checkpoint.h5")
    back, known = checkpoint.read(tmp_path / "checkpoint.h5"), sim.state()
    np.testing.assert_array_equal(back.state.pop("x"), known.pop("x"))
    assert back.state == known and back.header["scheme"] == "implicit"
    np.testing.assert_array_equal(back.scene().fluid, slump.fluid)
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.h5"]


@pytest.mark.parametrize("left", [b"", None])
def test_a_lost_checkpoint_is_refused_by_name_and_the_previous_one_used(tmp_path, slump, left):
    """A missing checkpoint is refused by name and the previous one used; for other damage see
    tests/cli/test_front_door.py."""
    path, sim = tmp_path / "checkpoint.h5", Falling(slump)
    checkpoint.save(sim, path)
    sim.time = 0.5
    checkpoint.save(sim, path)
    path.unlink() if left is None else path.write_bytes(left)
    good, remark = checkpoint.read_good(path)
    assert good.header["time"] == 0.0 and "continuing from checkpoint.previous.h5" in remark
    checkpoint.previous(path).write_bytes(b"also bad")
    with pytest.raises(mps.SceneError, match="checkpoint .*checkpoint.h5: (damaged|no such file)"):
        checkpoint.read_good(path)


def test_a_checkpoint_of_another_version_or_scene_is_refused(tmp_path, slump):
    path = tmp_path / "checkpoint.h5"
    checkpoint.save(Falling(slump), path)
    with pytest.raises(mps.SceneError, match="no longer makes the particles"):
        checkpoint.restore(path, mps.catalogue.build("slump", spacing=0.06))
    path.write_bytes(path.read_bytes().replace(f"checkpoint {checkpoint.VERSION} ".encode(), b"checkpoint 6 ", 1))
    with pytest.raises(mps.SceneError, match=rf"of format 6; must be of {checkpoint.VERSION} \(version 0.2.0 also"):
        checkpoint.read(path)


def test_a_rational_rate_stays_as_it_was_when_a_run_goes_on_for_longer(tmp_path):
    scene = mps.slump_cone(critical_strain_rate="rational", until=2.0, spacing=0.05, model="axisymmetric")
    longer = checkpoint.read(checkpoint.save(Falling(scene), tmp_path / "checkpoint.h5")).scene(4.0)
    assert longer.until == 4.0 and longer.material == scene.material


@pytest.mark.parametrize(
    ("made", "steps", "told"),
    [
        ({"yield_value": 1000.0}, 3, r"run.h5: yield_value = 1000 Pa, there 300 Pa"),
        ({"source": "film"}, 3, r"run.h5: scene = film, there slump"),
        ({}, 2, ""),
        ({"until": 2.0}, 3, ""),
        ({}, 5, ""),  # a power cut took the last rows
    ],
)
def test_a_checkpoint_of_another_run_is_refused(run, made, steps, told):
    keywords = {key: value for key, value in made.items() if key in ("yield_value", "until")}
    other = Falling(mps.catalogue.build("slump", **{"spacing": 0.05, "until": 1.0} | keywords), made.get("dt", 0.01))
    other.record_output = lambda _: None
    for _ in range(steps):
        other.step()
    state = checkpoint.Checkpoint.of(other, made.get("source", "slump"))
    refused = pytest.raises(mps.SceneError, match=rf"checkpoint a\.h5: of another run than .*{told}$")
    with refused if told else nullcontext():
        run.folder.check_checkpoint("a.h5", state)


def test_a_checkpoint_may_say_a_keyword_otherwise_than_an_earlier_version():
    header = {"source": "slump", "parameters": {"critical_strain_rate": 0.1, "new": 1.0}}
    there = {"critical_strain_rate": "rational", "old": 2.0}
    assert checkpoint.Checkpoint(header, {}).differing("slump", there) == ""
    with pytest.raises(mps.SceneError, match="its parameters are damaged"):
        checkpoint.Checkpoint(header, {}).differing("slump", None)


@pytest.mark.parametrize(
    "change",
    [
        {"material": mps.HerschelBulkley(yield_value=100.0, consistency=20.0, flow_index=1.3)},
        {"gravity": (0.0, 0.0, -1.6)},
        {"walls": (mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), slip=True),)},
    ],
)
def test_a_checkpoint_of_a_scene_that_was_changed_needs_the_scene_again(tmp_path, slump, change):
    changed = replace(slump, **change)
    state = checkpoint.read(checkpoint.save(Falling(changed), tmp_path / "checkpoint.h5"))
    with pytest.raises(mps.SceneError, match="scene slump has another material, gravity or wall .* restore"):
        state.scene()
    state.admit(changed)
