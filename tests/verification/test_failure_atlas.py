"""Each failure happens, and the default does not have it. Numbers of `docs/failure_atlas.md`."""

from pathlib import Path

import numpy as np
import pytest
from verification import failure_atlas as atlas

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parents[2] / "docs"


def test_steps_too_large():
    found = atlas.steps_too_large().numbers
    newmark, default = np.abs(found["newmark"]), np.abs(found["default"])
    worst = np.max(newmark[:, :3], axis=1)
    assert worst[0] > 0.2
    assert worst[1] > 0.2
    assert worst[2] > 0.05
    assert np.max(newmark[:, 3]) > 5.0
    assert found["quiet"] >= 4
    assert found["settled"]
    assert np.max(default[:3]) < 0.01
    assert default[3] < 0.05
    assert np.max(np.abs(found["exponential"][-1])) < 0.02


def test_newmark_rings_after_impacts_and_feeds_bouncing():
    found = atlas.ringing().numbers
    alternation = found["alternation"]
    assert alternation["Newmark"] > 10.0 * alternation["truth"]
    assert alternation["HHT"] < 1.5 * alternation["truth"]
    assert alternation["Exponential"] < 1.5 * alternation["truth"]
    assert np.max(found["newmark_energy"][0]) > 0.1
    assert np.max(found["newmark_energy"][1]) > 0.005
    assert np.max(np.abs(found["averaged_energy"])) < 1e-10


def test_smoothing_too_wide_is_biased_and_too_sharp_is_not_stiff():
    found = atlas.smoothing().numbers
    assert np.all(found["settled"])
    bias = found["bias"]
    assert bias[-1] > 0.3
    assert bias[-2] > 0.05
    assert 1.7 < found["order"] < 2.2
    # Beside exact contact, nothing changes.
    assert bias[0] < 1e-12
    assert found["steps"][0] == found["exact_steps"]
    evaluations = found["evaluations"]
    assert evaluations[0.0] < 1.2 * evaluations[0.3]


def test_few_harmonics_and_few_samples():
    found = atlas.harmonics_and_samples().numbers
    assert found["settled"]
    by_harmonics, by_samples = np.abs(found["by_harmonics"]), np.abs(found["by_samples"])
    assert by_harmonics[-1] > 0.03
    assert by_harmonics[0] < 2e-5
    # Two or five harmonics would do; too few samples are what spoils them.
    assert by_samples[4] > 50.0 * by_harmonics[4]
    assert by_samples[2] > 50.0 * by_harmonics[2]
    assert by_samples[0] < 1e-3
    assert found["series_least"] < -0.01
    assert found["least_force"] == 0.0


def test_newton_past_a_fold_is_not_settled():
    found = atlas.past_the_fold().numbers
    lost = ~found["settled"]
    assert np.all(lost[(found["speeds"] < 0.705) & (found["speeds"] > 0.565)])
    assert not np.any(lost[found["speeds"] > 0.715])
    # The point of least imbalance is given, and looks like a resonance.
    assert np.max(found["ratio"][lost]) > 4.0
    assert np.all(found["residual"][lost] > 1e-3)
    assert all(found["sweep_stable"])
    # Where Newton's method returns garbage, the machine has left the branch.
    below = found["sweep_speeds"] < 0.7
    assert np.max(found["sweep_ratio"][below & (found["sweep_speeds"] > 0.52)]) < 2.0


def test_cold_starts_see_one_branch():
    found = atlas.cold_starts().numbers
    assert found["stable"].sum() < found["stable"].size
    assert found["found"] < 0.7 * found["existing"]
    for known, swept in found["judged"].values():
        assert len(known) == len(swept)
        np.testing.assert_allclose(known, swept, rtol=2e-3)


def test_light_load_separates_everything():
    found = atlas.light_load().numbers
    shares = found["shares"]
    assert found["opens"][-1] > 0.9
    assert shares["harmonic balance"][-1] < 0.95
    assert shares["marching"][-1] < 0.8
    assert min(shares["shooting"]) > 0.9
    # Every orbit of the default sweep that has not settled is known for it.
    assert found["sweep"] > 0.5
    assert found["stable"] < shares["shooting"][-1]
    assert found["finite"]


def test_zero_damping():
    found = atlas.zero_damping().numbers
    assert np.min(found["drift"]) > 1e-3
    assert list(found["settled"]) == [True, True, False, True, True, True, True, True]
    assert np.max(found["closed_error"]) < 1e-12
    assert np.max(np.abs(found["multipliers"] - 1.0)) < 1e-10


def test_whole_contact_ratios_do_no_harm():
    found = atlas.whole_contact_ratios().numbers
    assert found["finite"]
    assert found["converged"]
    assert np.all(found["settled"])
    for swing in found["swing"].values():
        assert np.max(swing[[1, 3]]) < 1e-12
        assert np.max(swing[[0, 2, 4]]) < 1e-4
        # The same distance to either side of 2 excites as much, to first order.
        assert abs(swing[0] / swing[2] - 1.0) < 0.03
        assert abs(swing[5] / swing[6] - 1.0) < 0.03


def test_derivatives_through_long_marches():
    found = atlas.long_gradients().numbers
    gradient, implicit = np.abs(found["gradient"]), found["implicit"]
    # Chaos: each hundred cycles add many orders of magnitude.
    for lane in (0, 1):
        assert gradient[lane, 99] > 1e8
        assert gradient[lane, 399] > 1e8 * gradient[lane, 99]
        assert found["multiplier"][lane] > 1.0
    # The march is on the other branch, and its derivative is that branch's.
    assert abs(found["gradient"][2, -1] / implicit[2] - 1.0) > 0.5
    assert np.all(found["settled"][2:])
    assert np.max(np.abs(implicit / found["central"] - 1.0)[2:]) < 1e-5
    assert np.all(found["multiplier"][2:] < 1.0)
    assert abs(found["gradient"][4, -1] / implicit[4] - 1.0) < 5e-2


def test_unaligned_steps():
    found = atlas.unaligned_grid().numbers
    sampled, mean, aligned = (np.abs(found[name]) for name in ("sampled", "mean", "aligned"))
    assert sampled[-1] > 0.8 * aligned[1]
    assert abs(found["balance"]) < 2e-4
    for errors in (aligned, mean):
        order = np.log2(errors[:-1] / errors[1:])
        assert np.all((order > 1.7) & (order < 2.3)), order
    assert np.max(np.log2(sampled[:-1] / sampled[1:])) > 3.0 or np.min(sampled) > 1e-5


def test_light_modes_have_longer_periods_under_newmark():
    found = atlas.period_elongation().numbers
    worst = np.max(np.abs(found["newmark"]), axis=1)
    assert worst[0] > 1.0
    assert worst[1] > 0.5
    assert worst[2] > 0.1
    assert np.max(np.abs(found["balance"])) < 1e-12
    assert np.max(np.abs(found["exponential"][1])) < 0.01


def test_extreme_bodies_do_no_harm():
    found = atlas.extreme_bodies().numbers
    assert np.all(found["settled"])
    assert np.all(found["shot"])
    assert found["finite"]
    assert np.max(found["rigid"]) < 1e-6
    assert np.max(found["agreed"]) < 5e-3
    slices = found["slices"]
    assert all(settled for _, settled in slices.values())
    assert abs(slices[20][0] / slices[200][0] - 1.0) < 1e-3


def test_contact_loops_fail_where_newton_does_not():
    found = atlas.contact_loops().numbers
    shares = found["shares"]
    assert max(shares["loops, static"]) > 0.02
    assert max(shares["loops, step"]) > 0.01
    assert max(shares["Newton, static"]) == 0.0
    # In time steps: none up to the stiffness that marches meet.
    assert shares["Newton, step"][0] == 0.0
    assert found["apart"] < 1e-8


def test_slow_modes_have_not_settled():
    found = atlas.slow_modes().numbers
    assert min(found["worst"]) > 0.2
    assert np.min(found["drift"][:, [99, 199, 399]]) > 1e-4
    assert np.all(found["settled"])
    assert np.max(found["steps"]) <= 10.0
    assert np.all((found["multiplier"] > 0.99) & (found["multiplier"] < 1.0))


def test_harmless_looking_orbit_is_unstable():
    found = atlas.harmless_looking().numbers
    assert found["settled"]
    assert 1.38 < found["calm"] < 1.43
    assert found["multiplier"] > 1.05
    assert found["stable"]
    assert found["multiple"] == 2
    assert 3.0 < found["real"] < 3.2


def test_windows_between_two_speeds_are_found_by_the_branch():
    found = atlas.narrow_windows().numbers
    assert np.max(found["seen"]) < 0.995
    assert np.max(found["known"]) > 1.005
    assert found["edges"] == pytest.approx(found["closed_form"], rel=1e-4)
    assert found["unstable"] == 1
    assert found["points"] < 30


def test_every_row_has_its_section_and_its_picture():
    text = (DOCS / "failure_atlas.md").read_text(encoding="utf-8")
    for number, row in enumerate(atlas.ROWS, 1):
        assert f"\n## {number}. " in text
        assert f"]({atlas.picture_of(row)})" in text
        assert (DOCS / atlas.picture_of(row)).stat().st_size < 100_000
