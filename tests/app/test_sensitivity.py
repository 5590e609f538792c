"""What responses react to: shares, order, picture; and webs that are varied."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from matplotlib.patches import Rectangle
from table_checks import assert_tables
from tiny_cases import tiny_scene

from jaxgear import plot
from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear._interface._laws import ExactContact
from jaxgear._response._transmission import cycle_mean, transmission_error
from jaxgear._solve._cycle import mesh_cycle
from jaxgear.scene._build import grid_of, model_of
from jaxgear.scene._mesh_bodies import with_bodies
from jaxgear.scene._scene import read_scene
from jaxgear.scene._schema import of_condensed, scales_body
from jaxgear.study._built import BuiltScene
from jaxgear.study._design import design_space, refuse_unbounded
from jaxgear.study._sensitivities import acting, in_shares, lost, own_moduli, table_of

_KEYS = ("pair.torque_pinion_Nm", "flank.pinion.crowning_um", "wheel.profile_shift", "mesh.dead")
_WEB = "wheel.body.web.web_thickness_mm"
_MESH = "[mesh]\nslices = 2\nphases = 8\npinion_speed_rad_s = 2000\n"
_VARY = f"""[optimise]
vary = ["{_WEB}"]
[optimise.bounds]
"{_WEB}" = [2.0, 4.0]
"""


def _found(speed=np.nan) -> xr.Dataset:
    """A response of 2 that moves by 3 per unit of a key, and one that is 0."""
    values, centre = [2.0, 0.0], [50.0, 0.0, 0.0, 4.0]
    slopes = [[0.03, 3.0, 5.0, 0.0], [1.0, 1.0, 1.0, 0.0]]
    return in_shares(("te_mean_um", "te_rms_um"), values, _KEYS, centre, slopes, speed)


def test_shares_are_in_per_cent_of_what_the_key_is():
    found = _found()
    assert found["measure"].values.tolist() == ["%/%", "%/um", "%/0.01", "%/%"]
    np.testing.assert_allclose(found["sensitivity"][0], [0.75, 150.0, 2.5, 0.0])
    # A response that is 0 has no share.
    assert np.isnan(found["sensitivity"][1, :3]).all()
    assert not lost(found)
    alone = found.assign(sensitivity=np.nan * found["sensitivity"])
    assert lost(alone)[0].startswith(f"No response has a derivative by {', '.join(_KEYS)}.")
    assert acting(found)["key"].values.tolist() == [_KEYS[0], _KEYS[1], _KEYS[2]]
    assert list(table_of(acting(found))["te_mean_um"]) == [
        "value",
        "flank.pinion.crowning_um [%/um]",
        "wheel.profile_shift [%/0.01]",
        "pair.torque_pinion_Nm [%/%]",
    ]


def test_the_picture_has_a_panel_for_each_response_and_measure():
    found = acting(_found()).assign_attrs(title="title")
    (picture,) = plot.pictures({"sensitivity": found})
    assert picture.table["sensitivity"].shape == (6,)
    figure = picture.draw()
    assert len(figure.axes) == 6
    (bar,) = figure.axes[0].patches
    assert isinstance(bar, Rectangle)
    assert bar.get_width() == pytest.approx(0.75)
    assert [text.get_text() for text in figure.axes[1].texts] == ["none"]
    moving = xr.concat([_found(600.0), _found(900.0)], "case", data_vars="minimal")
    moving = acting(moving).assign_attrs(title="title")
    (picture,) = plot.pictures({"sensitivity_in_motion": moving})
    (legend,) = picture.draw().legends
    assert [text.get_text() for text in legend.get_texts()] == ["600 rad/s", "900 rad/s"]


@pytest.fixture
def write(tmp_path):
    """A function that writes the tiny scene with more lines and returns its path."""

    def written(more):
        path = tmp_path / "tiny.toml"
        path.write_text(tiny_scene(4, 20.0) + _MESH + more, encoding="utf-8")
        return path

    return written


def test_condensed_bodies_get_a_modulus_of_their_own(write):
    scene = read_scene(write("[wheel.material]\nyoung_GPa = 110\n"))
    scene = scene.replace(own_moduli(scene.material, scene.gears))
    assert scene.value("wheel.body.young_GPa") == 110.0
    assert scene.value("pinion.body.young_GPa") is None
    keys = set(scene.real_keys())
    assert {"wheel.body.young_GPa", "wheel.material.young_GPa", "material.density_kg_m3"} <= keys
    # Measures of a web have derivatives only if bodies were condensed for them.
    assert not [key for key in keys if key.startswith("wheel.body.web.")]
    assert not scales_body("material.poisson", "wheel")
    assert of_condensed(_WEB, "wheel")
    assert not of_condensed("wheel.body.mass_kg", "wheel")


def test_a_web_without_bounds_is_refused(write):
    with pytest.raises(InputError, match=r"condensed from one bound to the other"):
        with_bodies(read_scene(write(f'[optimise]\nvary = ["{_WEB}"]\n')))


def test_a_web_may_be_varied_before_its_bodies_are_built(write):
    """One measure of it, at rest: `optimise` looks at its variables before it builds anything."""
    refuse_unbounded(read_scene(write(_VARY)), (_WEB,))
    with pytest.raises(InputError, match="no bounds can be guessed"):
        refuse_unbounded(read_scene(write(f'[optimise]\nvary = ["{_WEB}"]\n')), (_WEB,))
    two = _VARY.replace(f'["{_WEB}"]', f'["{_WEB}", "wheel.body.web.hub_outer_mm"]')
    swept = _VARY + "[sweep]\npinion_speed_rad_s = [900]\n"
    for more in (two, swept):
        scene = read_scene(write(more))
        with pytest.raises(InputError, match="vary one measure of each gear"):
            refuse_unbounded(scene, tuple(scene.value("optimise.vary")))


@pytest.mark.slow
def test_responses_balance_all_that_is_stiff_against_all_that_loads(write, tmp_path, capsys):
    """All moduli, bearings, the torque and the density by 1 %: displacements stay as they are.

    And what is dense shakes as what turns fast: only the density times the speed's square counts.
    """
    moving = "[sweep]\npinion_speed_rad_s = [600]\nsteps = 16\nharmonics = 4\n"
    path = write("[flank.pinion.tip_relief]\ndepth_um = 8\n" + moving)
    out = tmp_path / "out"
    assert main(["sensitivity", str(path), "--json", "--out", str(out)]) == 0
    summary = json.loads(capsys.readouterr().out)
    found = summary["sensitivity"] | summary["sensitivity_in_motion"]
    scaled = ("young_GPa", "radial_N_m", "axial_N_m", "torque_pinion_Nm", "density_kg_m3")
    for name, share in (
        ("te_mean_um", 0.0),
        ("te_rms_um", 0.0),
        ("max_pressure_MPa", 1.0),
        ("face_load_factor", 0.0),
        ("mesh_stiffness_mean_N_um", 1.0),
        ("te_rms_dynamic_um_at_600_rad_s", 0.0),
        ("smooth_dynamic_ratio_at_600_rad_s", 0.0),
        ("bearing_force_order_1_N_at_600_rad_s", 1.0),
    ):
        own = {key.removesuffix(" [%/%]"): value for key, value in found[name].items()}
        total = sum(value for key, value in own.items() if key.endswith(scaled))
        assert total == pytest.approx(share, abs=1e-6), name
        if name.endswith("rad_s"):
            twice = 2.0 * own["material.density_kg_m3"]
            assert own["sweep.pinion_speed_rad_s"] == pytest.approx(twice, rel=1e-6)
    assert found["mesh_stiffness_mean_N_um"]["wheel.body.young_GPa [%/%]"] > 0.1
    for name in ("sensitivity", "sensitivity_in_motion"):
        assert (out / "sensitivity" / f"{name}.png").exists()
    assert len(assert_tables(out)) == 2


@pytest.mark.slow
def test_a_web_that_is_varied_is_as_if_condensed(write):
    """Response and derivative by thickness, against bodies made there, within the stated error."""
    scene = with_bodies(read_scene(write(_VARY)))
    family = scene.bodies["wheel"].family
    assert 1e-6 < family.interpolation_error < 2e-3
    assert _WEB in scene.real_keys()
    space = design_space(BuiltScene(scene), (_WEB,), symmetric=False, deflection=10.0)
    grid = grid_of(scene, model_of(scene))

    @jax.jit
    def mean_error(model):
        cycle = mesh_cycle(model, grid, law=ExactContact(), throw=False)
        return cycle_mean(cycle, transmission_error(model.pair, cycle))

    def condensed(thickness):
        text = tiny_scene(4, 20.0).replace(
            "web_thickness_mm = 3", f"web_thickness_mm = {thickness}"
        )
        path = write("").with_name("other.toml")
        path.write_text(text + _MESH, encoding="utf-8")
        return float(mean_error(model_of(with_bodies(read_scene(path)))))

    slope = jax.grad(lambda value: mean_error(space.model(value[None])))
    followed = float(mean_error(space.model(jnp.array([3.2]))))
    assert followed == pytest.approx(condensed(3.2), rel=family.interpolation_error)
    difference = (condensed(3.4) - condensed(3.0)) / 0.4
    # Differences over a step of 0.2 mm are off by their own curvature, a few thousandths.
    assert float(slope(jnp.asarray(3.2))) == pytest.approx(difference, rel=0.02)
    # Beyond the bounds nothing is known.
    with pytest.raises(ValueError, match="nothing is extrapolated"):
        model_of(scene.replace({_WEB: 4.5}))
    moving = read_scene(write(_VARY + "[sweep]\npinion_speed_rad_s = [900]\n"))
    still = with_bodies(moving, moving=True)
    with pytest.raises(InputError, match=r"In motion modes do not follow"):
        design_space(BuiltScene(still), (_WEB,), symmetric=False, deflection=10.0)
