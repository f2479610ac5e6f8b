"""history.csv keeps a column for every measure there ever was."""

import numpy as np

from taichi_mps.io.history import COLUMNS, TAIL, History, newest, read_history


def row(time, **measures):
    return {**dict.fromkeys(COLUMNS, 0.0), "time_s": time, **measures}


def test_a_measure_that_fails_at_the_start_or_later_keeps_its_column(tmp_path):
    path = tmp_path / "history.csv"
    history = History(path, {})  # at 0 s it gave nothing
    for time, measures in ((0.0, {}), (0.1, {"front_m": 1.0}), (0.2, {}), (0.3, {"front_m": 2.0, "height_m": 3.0})):
        history.add(row(time, **measures))
    history.close()
    found = read_history(path)
    assert tuple(found) == (*COLUMNS, "front_m", "height_m")
    np.testing.assert_array_equal(found["front_m"], [np.nan, 1.0, np.nan, 2.0])
    np.testing.assert_array_equal(found["height_m"], [np.nan, np.nan, np.nan, 3.0])
    again = History(path, {}, kept=0.2)  # resumed, where it fails
    again.add(row(0.3))
    again.close()
    np.testing.assert_array_equal(read_history(path)["front_m"], [np.nan, 1.0, np.nan, np.nan])


def test_the_newest_row_is_the_last_whole_one_of_a_file_that_grows(tmp_path):
    path = tmp_path / "history.csv"
    assert newest(path) == {}
    history = History(path, {"front_m": 0.0})
    assert newest(path) == {}
    for step in range(TAIL // 10):
        history.add(row(0.1 * step, front_m=2.0 * step))
    history.close()
    assert path.stat().st_size > 2 * TAIL
    last = read_history(path)
    with open(path, "a", encoding="utf-8") as file:
        file.write("77.0,0.1,0.")  # a row that is being written
    found = newest(path)
    assert (found["time_s"], found["front_m"]) == (last["time_s"][-1], last["front_m"][-1])
