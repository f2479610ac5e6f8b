"""Open box of the dam break: the fluid behind the gate stays until it is lifted, and a stiff block stands."""

import pytest

import taichi_mps as mps

BLOCK = {"model": "half", "spacing": 0.005, "column_width": 0.03, "column_height": 0.04, "density": 1000.0}


def after(until, **settings):
    """Measures of a run, judged by the check of its scene."""
    sim = mps.Simulation(mps.catalogue.build("dam_break", **BLOCK | settings, until=until))
    sim.run()
    sim.scene.check(sim.snapshot(), sim.measures())
    return sim.measures()


@pytest.mark.long
def test_the_gate_holds_what_it_has_not_left_yet():
    """A gate lifted by 2 mm of 40 mm holds a block that flows without it; a stiff block stands without a gate."""
    soft = {"yield_value": 5.0, "plastic_viscosity": 1.0}
    held, gone = (after(0.1, **soft, lift_speed=speed)["flow_m"] for speed in (0.02, None))
    assert held < 1e-3 < 1e-2 < gone
    stands = after(0.1, yield_value=1e4, plastic_viscosity=1.0)
    assert abs(stands["flow_m"]) < 1e-4 and stands["height_m"] == pytest.approx(0.04, rel=0.01)
    assert stands["breadth_m"] == pytest.approx(0.04, rel=0.01)


def test_the_open_box_is_told_from_the_tank():
    half = mps.catalogue.build("dam_break", **BLOCK | {"column_width": 0.0337})  # no multiple of the spacing
    volume = 2.0 * len(half.fluid) * half.spacing**3
    assert volume == pytest.approx(0.0337 * 0.04 * 0.04, rel=1e-12) and half.fluid[:, 1].min() > 0.0
    assert half.fluid[:, 0].max() == pytest.approx(0.0337 * 13 / 14, rel=1e-12)
