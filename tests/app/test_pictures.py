import csv
import re
import subprocess
import sys
from types import SimpleNamespace

import equinox as eqx
import jax
import matplotlib
import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.path import Path as Polygon
from matplotlib.text import Annotation

import jaxgear as jg
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._system._mesh_vectors import section_motion
from jaxgear._system._shaft import node_heights
from jaxgear.plot import _pictures as pictures
from jaxgear.plot import _tables as tables
from jaxgear.plot._cycle import cycle_statistics
from jaxgear.plot._modification_pictures import modification
from jaxgear.plot._modification_tables import modification_columns
from jaxgear.plot._sliding_pictures import sliding
from jaxgear.plot._sliding_tables import sliding_columns
from jaxgear.study._results import static_dataset

_UNIT = re.compile(r".+ \[[^\]]+\]$")


def _spur(depth: float = 0.0) -> jg.PairModel:
    pinion, wheel = jg.Gear(20, 12 * jg.mm, 0.2), jg.Gear(41, 10 * jg.mm, 0.1)
    relief = jg.TipRelief(depth * jg.um, 0.25)
    pair = jg.GearPair(pinion, wheel, 2 * jg.mm)
    return jg.PairModel(pair, 60.0, flanks=jg.Flanks(relief, relief))


def _relieved() -> jg.PairModel:
    return _spur(12.0)


def _helical() -> jg.PairModel:
    pinion, wheel = jg.Gear(25, 30 * jg.mm, 0.3), jg.Gear(31, 30 * jg.mm)
    pair = jg.GearPair(pinion, wheel, 3 * jg.mm, 20 * jg.deg, 15 * jg.deg)
    return jg.PairModel(pair, 300.0)


_FORCE = (-400.0, 150.0, 20.0)


def _mounted() -> jg.PairModel:
    """Both gears on shafts, the pinion's a piece of its shaft, and one tooth out of place."""
    pair = _helical().pair
    steps = jg.Segment(40 * jg.mm, 30 * jg.mm, 10 * jg.mm), jg.Segment(80 * jg.mm, 40 * jg.mm)
    bearings = [
        jg.Bearing(at * jg.mm, 4e8, 5e8, axial, 1e4, 1e4)
        for at, axial in ((0.0, 0.0), (100.0, 2e8))
    ]
    load = jg.ShaftLoad(20 * jg.mm, _FORCE)
    width = 30 * jg.mm
    body = jg.BeamBody(width, 68 * jg.mm)
    pinion = jg.Shaft(steps, bearings, 60 * jg.mm, 120 * jg.mm, [load], body_width=width)
    solid = [jg.Segment(120 * jg.mm, 40 * jg.mm)]
    wheel = jg.Shaft(solid, [bearings[1], jg.Bearing(0.0, 4e8, 4e8)], 50 * jg.mm)
    indexing = jg.Indexing([0.0, 4 * jg.um, *[0.0] * 23])
    return jg.PairModel(
        pair,
        300.0,
        flanks=jg.Flanks(pinion_indexing=indexing),
        pinion_support=pinion,
        wheel_support=wheel,
        pinion_body=body,
    )


_MODELS = {"spur": _spur, "relieved": _relieved, "helical": _helical, "mounted": _mounted}
# Phases, slices and periods of those that are solved.
_GRIDS = {"spur": (24, 6, 1), "relieved": (24, 6, 1), "mounted": (12, 6, 3)}


@pytest.fixture(scope="module")
def cycles():
    solve = eqx.filter_jit(jg.mesh_cycle)
    found = {}
    for name, (phases, slices, periods) in _GRIDS.items():
        model = _MODELS[name]()
        grid = jg.mesh_grid(model.pair, phases=phases, slices=slices, periods=periods)
        found[name] = model, solve(model, grid)
    return found


@pytest.fixture(scope="module")
def datasets(cycles):
    law = jg.ExactContact()
    return {name: static_dataset(model, cycle, law) for name, (model, cycle) in cycles.items()}


def _bearings(dataset):
    """As in the summary."""
    load = np.tensordot(dataset["weight"].values, dataset["bearing_load_N"].values, 1)
    owners = [("pinion", 0), ("pinion", 1), ("wheel", 0), ("wheel", 1)]
    return [
        {"gear": gear, "index": index, "load_N": dict(zip("STZ", row, strict=True))}
        for (gear, index), row in zip(owners, load, strict=True)
    ]


def _chart():
    """A map with a valley at depth 2/extent [um], and what goes with it."""
    extent, depth = np.linspace(0.05, 0.5, 19), np.linspace(0.0, 20.0, 21)
    value = 0.1 + np.abs(depth[:, None] - 2.0 / extent[None, :])
    # Short reliefs, for which every depth is bad: their best depth lies beyond the map.
    best = np.minimum(2.0 / extent, 20.0)
    chart = SimpleNamespace(extent=extent, depth=depth * jg.um, value=value)
    valley = SimpleNamespace(extent=extent, depth=best * jg.um, value=0.1 + np.abs(extent - 0.25))
    closed = np.where(extent > 0.1, 2.2 / extent, np.nan)
    return chart, valley, closed


_WIDTH = np.asarray([0.01, 0.1, 1.0, 10.0])
_BIAS = np.asarray([0.0, 1e-5, 1e-3, 0.1])
_TORQUES = np.asarray([20.0, 40.0, 60.0])
_PHASES = (np.arange(16) + 0.5) / 16
_WAVES = np.asarray([1.0, 2.0, 3.0])[:, None] * (4.0 + np.sin(2 * np.pi * _PHASES))
# Five mesh periods, and an order of a fifth besides the first.
_LONG_PHASES = np.concatenate([_PHASES + period for period in range(5)])
_LONG_WAVES = np.sin(2 * np.pi * _LONG_PHASES) + 0.5 * np.sin(0.4 * np.pi * _LONG_PHASES)
_LONG = _TORQUES, _LONG_PHASES, np.asarray([1.0, 2.0, 3.0])[:, None] * _LONG_WAVES
_SIZINGS = {
    "one": (["depth [µm]"], np.asarray([[10.0], [0.0], [5.0]])),
    "two": (["depth [µm]", "extent [-]"], np.asarray([[10.0, 0.2], [0.0, 0.2], [10.0, 0.3]])),
}
_SEARCHES = {"lbfgs": np.asarray([4.0, 5.0, 0.1]), "adam": np.asarray([4.0, 3.0, 2.0, 1.0])}


_COLUMNS = {
    pictures.transmission_error: tables.transmission_error_columns,
    pictures.stiffness_and_sharing: tables.load_sharing_columns,
    pictures.flank_maps: tables.flank_maps_columns,
    pictures.face_load: tables.face_load_columns,
}


def _all_pictures(datasets, cycles):
    """Every picture with its columns."""
    spur, relieved, mounted = (datasets[name] for name in _GRIDS)
    chart, valley, closed = _chart()
    path = np.asarray([[3.0, 0.2], [15.0, 0.3], [8.0, 0.25]])
    gradient = {"gradient_bias_relative": -2.0 * _BIAS}
    for name, make in _MODELS.items():
        yield f"gear_pair {name}", pictures.gear_pair(make()), tables.gear_pair_columns(make())
    for name, dataset in datasets.items():
        for make, columns in _COLUMNS.items():
            yield f"{make.__name__} {name}", make(dataset, f"{name}, 60 N m"), columns(dataset)
    yield (
        "harris_map",
        pictures.harris_map(_TORQUES, _PHASES, _WAVES, "waves"),
        tables.harris_map_columns(_TORQUES, _PHASES, _WAVES),
    )
    for torques, phases, waves in ((_TORQUES, _PHASES, _WAVES), _LONG):
        figure = pictures.te_spectrum(torques, phases, waves, "waves")
        columns = tables.te_spectrum_columns(torques, phases, waves)
        yield f"te_spectrum of {len(phases)}", figure, columns
    on_shafts, cycle = cycles["mounted"]
    yield (
        "shafts",
        pictures.shafts(on_shafts, cycle, _bearings(mounted), "mounted, 300 N m"),
        tables.shafts_columns(on_shafts, cycle),
    )
    flanks = modification_columns({"start": _spur(), "optimised": _relieved()})
    yield "modification", modification(flanks, "relief"), flanks
    slides = sliding_columns(_spur().pair)
    lost = {"mesh_efficiency": 0.99, "friction_coefficient": 0.05}
    yield "sliding", sliding(slides, spur, lost, "spur", pinion_speed=900.0), slides
    for name, (labels, amounts) in _SIZINGS.items():
        size = np.linspace(1.0, 3.0, 3 * len(amounts)).reshape(-1, 3)
        yield f"sizing {name}", pictures.sizing(labels, amounts, _TORQUES, size, size, name), {}
    yield (
        "smoothing_bias",
        pictures.smoothing_bias(_WIDTH, _BIAS, -_BIAS, 0.8, "bias", **gradient),
        tables.smoothing_bias_columns(_WIDTH, _BIAS, -_BIAS, **gradient),
    )
    yield (
        "master_curve",
        pictures.master_curve(chart, valley, closed, path, "map"),
        tables.master_curve_columns(chart),
    )
    yield (
        "search_trace",
        pictures.search_trace(_SEARCHES, "µm²", "searches"),
        tables.search_trace_columns(_SEARCHES, "um2"),
    )
    yield (
        "before_after",
        pictures.before_after(spur, relieved, "relief"),
        tables.before_after_columns(spur, relieved),
    )
    assert mounted.sizes["slice"] == 6


@pytest.fixture(scope="module")
def everything(datasets, cycles):
    return list(_all_pictures(datasets, cycles))


def test_axes_say_quantity_and_unit(everything):
    for name, figure, _ in everything:
        assert figure.get_suptitle(), name
        for axes in figure.axes:
            labels = [axes.get_ylabel()]
            if axes.get_label() != "<colorbar>":
                labels.append(axes.get_xlabel())
            for label in labels:
                assert _UNIT.match(label), f"{name}: {label!r}"


def _saved(figure, columns, folder):
    """Paths of PNG, SVG and CSV."""
    save(lambda: figure, columns, Folder(folder), "picture")
    return [folder / f"picture.{ending}" for ending in ("png", "svg", "csv")]


@pytest.mark.end_to_end
def test_pictures_show_something_in_every_axes(everything, tmp_path):
    for name, figure, columns in everything:
        paths = _saved(figure, columns, tmp_path)
        assert set(tmp_path.iterdir()) == set(paths)
        image = matplotlib.image.imread(paths[0])[..., :3]
        height, width = image.shape[:2]
        assert (width, height) == tuple((figure.get_size_inches() * 150).astype(int))
        for axes in figure.axes:
            box = axes.get_position()
            rows = slice(int(height * (1 - box.y1)) + 4, int(height * (1 - box.y0)) - 4)
            inside = image[rows, int(width * box.x0) + 4 : int(width * box.x1) - 4]
            coloured = np.ptp(inside, axis=2) > 0.1
            assert np.mean(coloured) > 2e-3, f"{name}: {axes.get_xlabel()}"
        assert paths[1].read_text(encoding="utf-8").startswith("<?xml")


def test_columns_are_written_beside(everything, tmp_path):
    for _, figure, columns in everything[4:8]:
        *_, table = _saved(figure, columns, tmp_path)
        with table.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
        assert rows[0] == list(columns)
        for index, values in enumerate(columns.values()):
            read = [float(row[index]) for row in rows[1:] if row[index]]
            np.testing.assert_allclose(read, values, rtol=1e-9, atol=1e-300)


def test_the_same_picture_is_the_same_file(datasets, tmp_path):
    written = []
    for _ in range(2):
        figure = pictures.transmission_error(datasets["spur"], "spur, 60 N m")
        written.append([path.read_bytes() for path in _saved(figure, {}, tmp_path)])
    assert written[0] == written[1]


def _drawn(figure: Figure, name: str) -> np.ndarray:
    (line,) = [line for line in figure.axes[0].lines if line.get_gid() == name]
    return np.asarray(line.get_xydata())


def _distance(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distance of each point to a polyline."""
    start, along = line[:-1], np.diff(line, axis=0)
    away = points[:, None] - start
    length = np.maximum(np.sum(along**2, axis=1), 1e-30)
    share = np.clip(np.sum(away * along, axis=2) / length, 0.0, 1.0)
    return np.min(np.linalg.norm(away - share[..., None] * along, axis=2), axis=1)


@pytest.mark.parametrize("make", [_spur, _helical])
def test_drawn_flanks_touch_at_the_pitch_point(make):
    model = make()
    figure = pictures.gear_pair(model)
    pitch_point = np.asarray([[float(model.pair.working_pitch_radius[0]) / jg.mm, 0.0]])
    for body in ("pinion", "wheel"):
        assert _distance(pitch_point, _drawn(figure, body))[0] * jg.mm < 1e-7


@pytest.mark.parametrize("make", [_spur, _helical])
def test_drawn_teeth_do_not_overlap(make):
    model = make()
    figure = pictures.gear_pair(model)
    pinion, wheel = _drawn(figure, "pinion"), _drawn(figure, "wheel")
    centre = [[float(model.pair.working_centre_distance) / jg.mm, 0.0]]
    body = Polygon(np.concatenate([wheel, centre, wheel[:1]]))
    inside = pinion[body.contains_points(pinion)]
    # Without backlash both flanks touch, so the chords of one run through the other.
    deepest = np.max(_distance(inside, wheel), initial=0.0)
    assert deepest * jg.mm < 1e-6
    # The loaded flanks touch where their common normal is the line of action: nowhere else
    # than at the pitch point is the gap zero, and next to it it stays small.
    near = pinion[np.abs(pinion[:, 1]) < 0.2]
    assert np.min(_distance(near, wheel)) * jg.mm < 1e-6


def test_drawn_teeth_reach_from_root_to_tip():
    for make in (_spur, _helical):
        pair = make().pair
        radius = np.hypot(*_drawn(pictures.gear_pair(make()), "pinion").T) * jg.mm
        assert np.min(radius) == pytest.approx(float(pair.root_radius[0]), rel=1e-9)
        assert np.max(radius) == pytest.approx(float(pair.tip_radius[0]), rel=1e-9)


def test_path_of_contact_is_drawn_to_scale():
    model = _spur()
    ends = _drawn(pictures.gear_pair(model), "path of contact") * jg.mm
    length = float(np.linalg.norm(np.diff(ends, axis=0)))
    assert length == pytest.approx(float(model.pair.path_of_contact), rel=1e-12)
    # A is on the wheel's tip circle and E on the pinion's.
    centre = np.asarray([float(model.pair.working_centre_distance), 0.0])
    assert np.linalg.norm(ends[0] - centre) == pytest.approx(float(model.pair.tip_radius[1]))
    assert np.linalg.norm(ends[1]) == pytest.approx(float(model.pair.tip_radius[0]))


def test_transmission_error_repeats_and_names_its_statistics(datasets):
    dataset = datasets["spur"]
    figure = pictures.transmission_error(dataset, "spur")
    x, y = np.asarray(figure.axes[0].lines[0].get_xydata()).T
    np.testing.assert_allclose(y[:24], y[24:])
    np.testing.assert_allclose(x[24:] - x[:24], 1.0)
    text = figure.axes[0].get_title(loc="left")
    said = [float(x) for x in re.findall(r"([0-9.]+) µm", text)]
    assert said == pytest.approx(cycle_statistics(dataset["transmission_error_um"]), rel=5e-3)


def test_sharing_of_a_spur_pair_goes_from_nothing_to_all_and_back(datasets):
    columns = tables.load_sharing_columns(datasets["spur"])
    roll, share = columns["roll_mm"], columns["load_sharing"]
    points = datasets["spur"]["path_point_roll_mm"].values
    assert np.all(np.diff(roll) > 0.0)
    np.testing.assert_allclose(share[(roll > points[1]) & (roll < points[3])], 1.0)
    # Beyond the ends of the path the share is rounding.
    assert share[0] < 1e-6
    assert share[-1] < 1e-6
    assert 0.2 < share[1] < 0.6


def test_harris_statistics_by_hand():
    columns = tables.harris_map_columns(_TORQUES, _PHASES, _WAVES)
    np.testing.assert_allclose(columns["te_mean_um"], [4.0, 8.0, 12.0])
    np.testing.assert_allclose(columns["te_rms_um"], np.asarray([1.0, 2.0, 3.0]) / np.sqrt(2.0))
    uneven = tables.harris_map_columns(
        _TORQUES[:1],
        np.asarray([0.0, 0.5]),
        np.asarray([[0.0, 1.0]]),
        weight=np.asarray([0.8, 0.2]),
    )
    np.testing.assert_allclose(uneven["te_mean_um"], 0.2)
    np.testing.assert_allclose(uneven["te_rms_um"], 0.4)


def test_spectrum_by_hand():
    """Orders of sines come out with their amplitudes, between the mesh harmonics too."""
    columns = tables.te_spectrum_columns(*_LONG)
    order, amplitudes = (
        columns[name].reshape(len(_TORQUES), -1) for name in ("order", "te_order_um")
    )
    assert np.array_equal(np.unique(columns["torque_pinion_Nm"]), _TORQUES)
    order = order[0]
    expected = np.where(np.isclose(order, 1.0), 1.0, np.where(np.isclose(order, 0.2), 0.5, 0.0))
    assert order[0] == 0.2
    for torque, amplitude in enumerate(amplitudes):
        np.testing.assert_allclose(amplitude, (torque + 1) * expected, atol=1e-12)


def test_a_long_cycle_is_drawn_once(cycles, datasets):
    """From 0 to its end; each of its tooth pairs by itself; its harmonics are the library's."""
    model, cycle = cycles["mounted"]
    columns = tables.transmission_error_columns(datasets["mounted"])
    assert len(columns["phase"]) == cycle.approach.size
    assert np.all(np.diff(columns["phase"]) > 0.0)
    assert 2.9 < columns["phase"][-1] < 3.0
    amplitudes = jg.harmonic_amplitudes(cycle, jg.transmission_error(model.pair, cycle), 5)
    harmonics = tables.te_harmonics_columns(datasets["mounted"])["te_harmonic_um"]
    np.testing.assert_allclose(harmonics, amplitudes / jg.um, rtol=1e-9)
    sharing = tables.load_sharing_columns(datasets["mounted"])
    assert np.unique(sharing["tooth_pair"]).tolist() == [0, 1, 2]
    for pair in range(3):
        own = sharing["tooth_pair"] == pair
        assert np.all(np.diff(sharing["roll_mm"][own]) > 0.0)
        assert np.max(np.abs(np.diff(sharing["load_sharing"][own]))) < 0.4


def test_face_load_adds_up_to_the_mesh_force(datasets):
    for dataset in datasets.values():
        columns = tables.face_load_columns(dataset)
        np.testing.assert_allclose(
            columns["face_load_mean_N_mm"], dataset["face_load_N_mm"], rtol=1e-9
        )
        force = np.mean(columns["face_load_at_largest_N_mm"]) * dataset.attrs["face_width_mm"]
        assert force == pytest.approx(float(dataset["mesh_force_N"][0]), rel=1e-9)
    factor = np.max(columns["face_load_mean_N_mm"]) / np.mean(columns["face_load_mean_N_mm"])
    legend = pictures.face_load(dataset, "mounted").axes[0].get_legend()
    assert legend is not None
    assert any(f"{factor:.3f}" in text.get_text() for text in legend.get_texts())


def test_deflected_lines_carry_the_loads_of_the_bearings(cycles, datasets):
    """Deflection at a bearing times its stiffness is its load; all loads balance."""
    model, cycle = cycles["mounted"]
    bearings = _bearings(datasets["mounted"])
    lines, rows = tables.shafts_columns(model, cycle), tables.bearing_columns(model, bearings)
    shafts = {"pinion": model.pinion_support, "wheel": model.wheel_support}
    for index, each in enumerate(bearings):
        spring = shafts[each["gear"]].bearings[each["index"]]
        place, own = rows["Z_mm"][index], lines["gear"] == each["gear"]
        for axis, stiffness in (("S", spring.radial_s), ("T", spring.radial_t)):
            line = lines[f"deflection_{axis}_um"][own]
            moved = np.interp(place, lines["Z_mm"][own], line) * jg.um
            load = each["load_N"][axis]
            assert float(stiffness) * moved == pytest.approx(load, rel=1e-6)
            assert rows[f"load_{axis}_N"][index] == load
    for axis, outside in zip("STZ", _FORCE, strict=True):
        # What the mesh puts on one gear it takes from the other.
        assert np.sum(rows[f"load_{axis}_N"]) == pytest.approx(outside, abs=1e-3)


@pytest.mark.parametrize(
    "at",
    [
        np.append(np.linspace(0.0, 24.0, 6), 100.0),
        np.append(np.linspace(0.0, 40.0, 20), 100.0),
        [0.0, 100.0],
    ],
)
def test_labels_of_bearings_hide_nothing(cycles, at):
    """However close the bearings are; none is moved where there is room."""
    model, _ = cycles["mounted"]
    steps = [jg.Segment(120 * jg.mm, 40 * jg.mm)]
    bearings = [jg.Bearing(z * jg.mm, 4e8, 4e8) for z in at]
    shaft = jg.Shaft(steps, bearings, 50 * jg.mm)
    crowded = eqx.tree_at(lambda m: m.wheel_support, model, shaft)
    loads = [
        {"gear": "wheel", "index": i, "load_N": dict.fromkeys("STZ", -1e5 - i)}
        for i in range(len(at))
    ]
    figure = Figure(figsize=pictures._side_view_size(crowded), layout="constrained")
    axes = figure.subplots()
    axes.set(aspect="equal", xlim=(-60.0, 80.0), ylim=(-50.0, 150.0))
    pictures._write_bearing_loads(axes, crowded, loads)
    figure.draw_without_rendering()
    notes = [x for x in axes.texts if isinstance(x, Annotation)]
    texts = [x for x in notes if x.get_text()]
    assert len(texts) == len(at)
    boxes = [text.get_window_extent() for text in texts]
    poles = [x.arrow_patch.get_window_extent() for x in notes if x.arrow_patch is not None]
    assert len(poles) == (len(at) - 1 if len(at) > 2 else 0)
    for index, box in enumerate(boxes):
        others = boxes[:index] + boxes[index + 1 :] + poles
        assert not any(box.overlaps(other) for other in others)
        assert axes.bbox.x0 < box.x0
        assert box.x1 < axes.bbox.x1
        assert axes.bbox.y0 < box.y0
        assert box.y1 < axes.bbox.y1


def test_places_of_labels_by_hand():
    """Flags fly away from the gear, the outermost lowest; far from others they stay."""
    row, aside = pictures._label_places(np.asarray([-10.0, -12.0, -40.0, 1.0, 8.0, 14.0]), 9.0)
    assert aside.tolist() == [-1, -1, 0, 1, 1, 1]
    assert row.tolist() == [1, 0, 0, 2, 1, 0]
    # Next to each other on either side of mid-face they need but one row.
    row, aside = pictures._label_places(np.asarray([-1.0, 1.0]), 9.0)
    assert (row.tolist(), aside.tolist()) == ([0, 0], [-1, 1])


def test_deflected_line_of_a_beam_body_is_the_motion_of_its_sections(cycles):
    """The line and the mesh take the same beam, also where the body is of another material."""
    model, _ = cycles["mounted"]
    shaft = model.pinion_support
    body = jg.BeamBody(30 * jg.mm, 68 * jg.mm, jg.Material(poisson=0.45))
    heights = node_heights(shaft, body)
    motion = np.random.default_rng(3).normal(size=6 * len(heights)) * jg.um
    z, *moved = np.asarray(jax.jit(tables._line_of_shaft)(shaft, body, motion))
    first = shaft.layout.gear_nodes[0]
    count = tables._POINTS_OF_BEAM
    inside = slice(first * count, (first + 1) * count)
    sections = jax.vmap(lambda at: section_motion(shaft, body, at))
    expected = jax.jit(sections)(z[inside]) @ motion[6 * first : 6 * first + 12]
    np.testing.assert_allclose(np.transpose(moved)[inside], expected[:, :2], rtol=1e-9, atol=1e-18)


def test_torques_of_the_side_view_balance(cycles):
    """The wheel's is the pinion's times the ratio of teeth."""
    model, _ = cycles["mounted"]
    assert pictures._torque_on(model, 0) == 300.0
    assert pictures._torque_on(model, 1) == pytest.approx(300.0 * 31 / 25)


def test_bias_that_is_zero_is_not_on_the_logarithmic_line():
    figure = pictures.smoothing_bias(_WIDTH, _BIAS, _BIAS, 0.8, "bias")
    line, zeros = figure.axes[0].lines
    np.testing.assert_array_equal(line.get_xdata(), _WIDTH[1:])
    np.testing.assert_array_equal(zeros.get_xdata(), _WIDTH[:1])


def test_valley_ends_where_it_leaves_the_map():
    chart, valley, closed = _chart()
    figure = pictures.master_curve(chart, valley, closed, np.zeros((0, 2)), "map")
    drawn = {line.get_label(): line for line in figure.axes[0].lines}
    assert set(drawn) == {"valley, computed", "closed form"}
    points = np.asarray(drawn["valley, computed"].get_xydata())
    x, y = points[np.isfinite(points[:, 1])].T
    np.testing.assert_allclose(y, 2.0 / x)
    assert np.min(x) == pytest.approx(0.125)
    assert np.nanmax(np.asarray(drawn["closed form"].get_ydata())) <= 20.0


def test_a_valley_that_jumps_is_broken_and_no_closed_form_is_no_line():
    chart, valley, closed = _chart()
    depth = valley.depth.copy()
    depth[-1] = 0.9 * chart.depth[-1]
    jumping = SimpleNamespace(extent=valley.extent, depth=depth, value=valley.value)
    nothing = np.full_like(closed, np.nan)
    figure = pictures.master_curve(chart, jumping, nothing, np.zeros((0, 2)), "map")
    (line,) = figure.axes[0].lines
    assert line.get_label() == "valley, computed"
    assert np.isnan(np.asarray(line.get_ydata())[-1])


def test_trace_is_the_best_so_far():
    figure = pictures.search_trace(_SEARCHES, "µm²", "searches")
    assert np.asarray(figure.axes[0].lines[0].get_ydata()).tolist() == [4.0, 4.0, 0.1]
    assert figure.axes[0].get_xscale() == "log"


def test_configuration_is_left_alone(datasets):
    before = dict(matplotlib.rcParams)
    pictures.flank_maps(datasets["spur"], "spur")
    assert dict(matplotlib.rcParams) == before


def test_pyplot_stays_away():
    code = "import sys, jaxgear.plot._pictures; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_both_files_have_the_layout_that_each_would_have_alone(datasets, tmp_path):
    _saved(pictures.flank_maps(datasets["spur"], "spur"), {}, tmp_path)
    for ending, dots in (("png", 150), ("svg", "figure")):
        alone = pictures.flank_maps(datasets["spur"], "spur")
        with pictures._house_look():
            alone.savefig(tmp_path / f"alone.{ending}", dpi=dots)
    shown, expected = (
        matplotlib.image.imread(tmp_path / f"{name}.png") for name in ("picture", "alone")
    )
    np.testing.assert_array_equal(shown, expected)
    (words, places), (own, reference) = (
        _words(tmp_path / f"{name}.svg") for name in ("picture", "alone")
    )
    assert words == own
    # Letters are a little narrower in print than on a screen: a point at most.
    np.testing.assert_allclose(places, reference, atol=1.0)


def _words(svg):
    """Text of an SVG, and its places [points]."""
    found = re.findall(r"<text ([^>]*)>([^<]*)<", svg.read_text(encoding="utf-8"))
    places = [re.findall(r"-?[0-9.]+", re.sub(r'style="[^"]*"', "", about)) for about, _ in found]
    return [word for _, word in found], [[float(x) for x in place[:2]] for place in places]


def test_without_pictures_data_is_written_all_the_same(tmp_path):
    draw = lambda: pictures.search_trace(_SEARCHES, "-", "searches")
    columns = tables.search_trace_columns(_SEARCHES, "-")
    bare, beside = tmp_path / "bare", {"x_um": np.asarray([1.0])}
    bare.mkdir()
    save(draw, columns, Folder(tmp_path), "search", more=beside)
    save(draw, columns, Folder(bare, pictures=False), "search", more=beside)
    names = ["search.csv", "search.png", "search.svg", "search_more.csv"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bare", *names]
    assert sorted(path.name for path in bare.iterdir()) == [names[0], names[3]]
    assert (bare / names[0]).read_bytes() == (tmp_path / names[0]).read_bytes()


def test_commands_come_without_matplotlib(tmp_path):
    """Also those of condensed bodies, searches and comparisons."""
    code = (
        "import pathlib, sys\n"
        "import jaxgear._cli._commands, jaxgear.study._fidelity._compare, jaxgear.study._condense\n"
        "import jaxgear.plot._hybrid_tables, jaxgear.study._sensitivities\n"
        "import jaxgear.plot._wave_tables\n"
        "from jaxgear._cli._folder import Folder\n"
        "from jaxgear._cli._saving import save\n"
        "save(None, {'a': [1.0]}, Folder(pathlib.Path(sys.argv[1]), pictures=False), 'a')\n"
        "sys.exit('matplotlib' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code, tmp_path], check=False).returncode == 0
