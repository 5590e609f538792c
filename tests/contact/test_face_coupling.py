"""Teeth that feel a load along their face, against closed forms and 3-D finite elements."""

import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, quick

import jaxgear as jg
from jaxgear import deg, mm
from jaxgear._contact._face_cells import FaceCells, face_cells
from jaxgear._contact._face_coupling import STRIP, end_images, face_operator, leaning_operator
from jaxgear._geometry._lines import contact_lines

FE = json.loads((Path(__file__).parents[1] / "data" / "fe3d" / "accessory.json").read_text())
SLICES, TORQUE = 20, 80.0


def _real(number: float) -> jax.Array:
    return jnp.asarray(number, dtype=float)


# --- the operator


@pytest.mark.parametrize("length", [1e-9, 1e-5, 1e-3, 1.0, 1e6])
def test_an_even_load_is_met_evenly_whatever_the_length(length):
    operator = np.asarray(face_operator(_real(length), 7, _real(0.01), _real(0.01)))
    assert_close(operator.sum(axis=1) * 0.01 / 7, np.ones(7), rtol=1e-13, atol=0.0)
    assert_close(operator, operator.T, rtol=1e-13, atol=0.0)
    assert np.linalg.eigvalsh(operator).min() > -1e-12 * operator.max()


def test_a_cosine_load_is_met_by_its_wave_number():
    """$1/(1 + k^2 l^2)$, for fine slices that cover the face."""
    width, length, slices = 0.012, 0.003, 400
    operator = np.asarray(face_operator(_real(length), slices, _real(width), _real(width)))
    place = (np.arange(slices) + 0.5) / slices
    for number in (1, 3):
        load, wave = np.cos(number * np.pi * place), number * np.pi / width
        assert_close(
            operator @ load * width / slices,
            load / (1.0 + (wave * length) ** 2),
            rtol=1e-3,
            atol=1e-5,
        )


def test_slices_are_means_of_finer_ones():
    """What is independent of the number of slices: two halves of a slice are that slice."""
    fine, coarse = (
        np.asarray(face_operator(_real(0.002), n, _real(0.01), _real(0.014))) for n in (12, 6)
    )
    assert_close(fine.reshape(6, 2, 6, 2).mean(axis=(1, 3)), coarse, rtol=1e-12, atol=0.0)
    fine, coarse = (
        np.asarray(end_images(_real(0.002), n, _real(0.01), _real(0.014))) for n in (12, 6)
    )
    assert_close(fine.reshape(6, 2, 6, 2).mean(axis=(1, 3)), coarse, rtol=1e-12, atol=0.0)


def test_teeth_that_do_not_lean_have_the_operator_of_spur_ones():
    length, face = jnp.asarray([2e-3, 5e-3]), _real(0.014)
    place = (12, _real(0.01), face, _real(0.0), _real(0.0))
    found = leaning_operator(length, jnp.zeros(2), *place)
    assert_close(found, face_operator(length, 12, _real(0.01), face), rtol=1e-10, atol=0.0)


@pytest.mark.parametrize("slices", [1, 2, 24])
def test_teeth_that_lean_are_softer_where_they_lean_over_their_end(slices):
    """Reciprocal, positive, and in balance: what is pressed beyond the end is borne at it."""
    length, face = jnp.asarray([2e-3, 5e-3]), _real(0.01)
    place = (slices, face, face, _real(0.8e-3), _real(0.0))
    found = np.asarray(leaning_operator(length, jnp.asarray([0.3e-3, 0.0]), *place))
    assert_close(found, np.swapaxes(found, 1, 2), rtol=1e-12, atol=0.0)
    assert np.all(np.linalg.eigvalsh(found) > -1e-12 * found.max())
    even = 0.01 / slices * found.sum(axis=2)
    assert np.all(np.diff(even, axis=1) >= -1e-9)
    # Nothing is lost of the second part, which therefore bears on the whole as without a shift.
    if slices == 24:
        assert even[1, 0] < 0.95 < 1.05 < even[1, -1]
        assert abs(even[1].mean() - 1.0) < 0.05 < even[0].mean() - 1.0


def test_an_overhang_makes_a_tooth_stiffer_towards_what_a_long_one_gives():
    """A load over b in the middle of an endless face: $1 - l(1 - e^{-b/l})/b$ of its compliance."""
    width, length = 0.01, 0.003
    mean = [
        float(face_operator(_real(length), 1, _real(width), _real(face))[0, 0]) * width
        for face in (0.01, 0.012, 1.0)
    ]
    assert_close(mean[0], 1.0, rtol=1e-12, atol=0.0)
    endless = 1.0 - length / width * (1.0 - np.exp(-width / length))
    assert mean[0] > mean[1] > mean[2]
    assert_close(mean[2], endless, rtol=1e-12, atol=0.0)


def test_a_narrow_gear_is_in_plane_stress_and_a_wide_one_in_plane_strain():
    law = jg.FaceCoupling()
    at = lambda width: float(law.finite_width(_real(width), _real(1e-3), _real(0.3)))
    assert_close(at(1e-6), 1.0 / 0.91, rtol=1e-6, atol=0.0)
    assert 1.0 < at(1.0) < 1.0005
    assert_close(float(law.end_image(_real(0.3), _real(0.5 * np.pi))), 0.39, rtol=1e-12, atol=0.0)


def test_lengths_that_mean_nothing_are_refused():
    with pytest.raises(ValueError, match="positive"):
        jg.FaceCoupling(beam=0.0)
    with pytest.raises(ValueError, match="no less than"):
        jg.FaceCoupling(body=1.0)


# --- whole teeth


def _accessory(helix: float = 0.0, faces: tuple[float, float] = (11.5, 9.5)) -> jg.GearPair:
    gears = [
        jg.Gear(
            teeth,
            width * mm,
            shift,
            bore=bore * mm,
            addendum=0.9447,
            dedendum=1.1933,
            fillet_radius=0.25,
        )
        for teeth, width, shift, bore in zip(
            (45, 86), faces, (0.341, 0.481), (30.0, 40.0), strict=True
        )
    ]
    return jg.GearPair(
        *gears,
        normal_module=1.5 * mm,
        pressure_angle=25.0 * deg,
        helix_angle=helix * deg,
    )


def _cells(pair: jg.GearPair, law: jg.FaceCoupling) -> FaceCells:
    return _cells_on(pair, law, jg.mesh_grid(pair, phases=8, slices=4))


@eqx.filter_jit
def _cells_on(pair: jg.GearPair, law: jg.FaceCoupling, grid: jg.MeshGrid) -> FaceCells:
    lines = contact_lines(pair, grid)
    load = jg.nominal_line_load(pair, _real(TORQUE))
    found = face_cells(pair, lines, jg.WeberBanaschek(face_coupling=law), load)
    assert found is not None
    return found


@pytest.mark.slow
@pytest.mark.parametrize("helix", quick(1, [30.0, 0.0, -12.0]))
def test_cells_are_reciprocal_and_give_way_to_any_load(helix):
    coupling = np.asarray(_cells(_accessory(helix), jg.FaceCoupling()).coupling)
    assert_close(coupling, np.swapaxes(coupling, 1, 2), rtol=1e-12, atol=1e-22)
    assert np.all(np.linalg.eigvalsh(coupling) > -1e-14 * coupling.max())


@pytest.mark.slow
def test_an_even_load_meets_the_teeth_of_today():
    """On equal faces, without the softer ends: $c$ of the pair and its bodies at each line."""
    pair = _accessory(faces=(9.5, 9.5))
    cells = _cells(pair, jg.FaceCoupling(free_end=0.0))
    compliance = jg.WeberBanaschek(face_coupling=jg.FaceCoupling())
    lines = contact_lines(pair, jg.mesh_grid(pair, phases=8, slices=4))
    load = jg.nominal_line_load(pair, _real(TORQUE))
    size = 4
    dense = np.asarray(cells.coupling).reshape(8, -1, size, lines.roll.shape[1], size)
    # Loads on one line alone, even over its slices.
    coupled = np.einsum("plslt->pls", dense) * float(lines.length)
    alone = np.asarray(eqx.filter_jit(compliance)(pair, lines.roll, load))
    on_path = np.asarray((lines.roll > pair.path_start) & (lines.roll < pair.path_end))
    found = np.asarray(cells.local) + coupled
    assert_close(found[on_path], alone[on_path], rtol=1e-3, atol=0.0)
    wider = float(jg.FaceCoupling().finite_width(_real(9.5e-3), _real(1.5e-3), _real(0.3)))
    assert_close(wider, 1.05, rtol=1e-3, atol=0.0)


def _modes(gear: int) -> tuple[np.ndarray, np.ndarray]:
    """Compliance of the lines of one gear by cosines along the face, and to the next pair."""
    pair, name = _accessory(), ("pinion", "wheel")[gear]
    roll = jnp.asarray(FE[name]["xi_mm"]) * mm
    law = jg.FaceCoupling()
    load = jg.nominal_line_load(pair, _real(TORQUE))
    compliance = jg.WeberBanaschek(face_coupling=law)
    bodies = eqx.filter_jit(compliance.bodies)(pair, 1)
    parts = eqx.filter_jit(compliance.along_face)(pair, roll, load, bodies)
    assert parts is not None
    common, face = pair.face_width, (pair.pinion, pair.wheel)[gear].face_width
    place = (np.arange(SLICES) + 0.5) / SLICES
    waves = np.cos(np.pi * np.outer(np.arange(8), place))
    waves /= np.linalg.norm(waves, axis=1)[:, None]
    within = lambda c: np.einsum("ns,...st,nt->...n", waves, np.asarray(c), waves)
    beam, root, body = (
        float(common) / SLICES * within(face_operator(parts.lengths, SLICES, common, face))
    )
    shared = next(body for body in bodies if body.gear == gear and not body.axial)
    given = np.asarray(shared.compliance(roll))[:, None]
    own = np.asarray(parts.beam[gear])[:, None] * beam + given * body
    own += np.asarray(parts.root[gear])[:, None] * (root - body)
    # Without the gap of the ellipse, a quarter in units of the logarithm; by many lengths.
    share = (np.arange(40) + 0.5) / 40
    logarithm = np.log(np.asarray(parts.longest[gear] / parts.shortest))
    reach = np.asarray(parts.shortest)[:, None] * np.exp(logarithm[:, None] * share)
    contact = face_operator(jnp.asarray(reach), SLICES, common, face)
    contact += end_images(jnp.asarray(reach), SLICES, common, face, parts.end_image[gear])
    each = float(common) / SLICES * within(contact).mean(axis=1) * logarithm[:, None] - 0.25
    own += float(parts.per_log[gear]) * each
    felt = np.asarray(shared.resultants(roll)) @ np.asarray(shared.at_roots(1))
    cross = np.sum(felt[:4] * np.asarray(shared.resultants(roll))[8:], axis=1)
    return own * 1e12, cross[:, None] * body * 1e12


@pytest.mark.slow
@pytest.mark.parametrize("gear", quick(1, [0, 1]))
def test_modes_along_the_face_against_finite_elements(gear):
    name = ("pinion", "wheel")[gear]
    own, cross = _modes(gear)
    truth, between = np.asarray(FE[name]["own"]), np.asarray(FE[name]["cross"])
    assert np.sqrt(np.mean((own / truth - 1.0) ** 2)) < 0.045
    # The even part, which the mean of the transmission error is made of.
    assert np.max(np.abs(own[:, 0] / truth[:, 0] - 1.0)) < 0.03
    assert np.max(np.abs(cross - between)) < 0.06 * between[:, 0].max()
    # Slices apart meet the last mode with five to nine times its compliance.
    assert np.all(own[:, 0] / own[:, 7] > 3.0)


def test_shortest_length_is_that_of_a_strip_on_a_half_space():
    r"""$\ln(1/(k t_0))$ against the mean of $K_0(kx)$ over Hertz' ellipse and its gap."""
    from scipy.special import k0

    wave, half = 0.05, 1.0
    angle = (np.arange(20000) + 0.5) / 20000 * np.pi
    middle = np.mean(2.0 * np.sin(angle) ** 2 * k0(wave * np.abs(half * np.cos(angle))))
    assert_close(np.log(1.0 / (wave * STRIP * half)), middle, rtol=1e-3, atol=0.0)
