"""Pictures of a run, drawn of its datasets: what they show, and how they are written."""

import csv
import re
import subprocess
import sys

import equinox as eqx
import jax
import matplotlib
import matplotlib.image
import numpy as np
import pytest
import xarray as xr
from helpers import quick
from matplotlib.figure import Figure
from matplotlib.path import Path as Polygon
from matplotlib.text import Annotation
from table_checks import assert_table

import jaxgear as jg
from jaxgear import plot
from jaxgear._cli._folder import Folder
from jaxgear._cli._main import main
from jaxgear._cli._writing import save
from jaxgear._system._shaft import node_heights
from jaxgear._whole_file import write_csv, write_dataset
from jaxgear.plot import _bearing_labels as bearing_labels
from jaxgear.plot import _cycle_pictures as pictures
from jaxgear.plot import _cycle_tables as tables
from jaxgear.plot._cycle import cycle_statistics
from jaxgear.plot._pair_pictures import gear_pair
from jaxgear.plot._style import house_look, write_picture
from jaxgear.study import _pair_dataset as pair_dataset
from jaxgear.study import _shafts
from jaxgear.study._results import static_dataset

_UNIT = re.compile(r".+ \[[^\]]+\]$")


# Quick to compile; what is drawn does not depend on it.
_TEETH = jg.ConstantStiffness(14e9)


def _spur(depth: float = 0.0) -> jg.PairModel:
    pinion, wheel = jg.Gear(20, 12 * jg.mm, 0.2), jg.Gear(41, 10 * jg.mm, 0.1)
    relief = jg.TipRelief(depth * jg.um, 0.25)
    pair = jg.GearPair(pinion, wheel, 2 * jg.mm)
    return jg.PairModel(pair, 60.0, flanks=jg.Flanks(relief, relief), compliance=_TEETH)


def _relieved() -> jg.PairModel:
    return _spur(12.0)


def _helical() -> jg.PairModel:
    pinion, wheel = jg.Gear(25, 30 * jg.mm, 0.3), jg.Gear(31, 30 * jg.mm)
    pair = jg.GearPair(pinion, wheel, 3 * jg.mm, 20 * jg.deg, 15 * jg.deg)
    return jg.PairModel(pair, 300.0, compliance=_TEETH)


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
        compliance=_TEETH,
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
def groups(cycles):
    """The datasets of each case, as a run has them."""
    return {name: _groups(model, cycle) for name, (model, cycle) in cycles.items()}


@pytest.fixture(scope="module")
def datasets(groups):
    return {name: each[""] for name, each in groups.items()}


def _groups(model, cycle):
    found = static_dataset(model, cycle, jg.ExactContact())
    found = found.assign_coords(torque_Nm=("torque", _TORQUES, _TORQUE))
    error = _TORQUES[:, None] / 60.0 * found["transmission_error_um"].values
    found["harris_te_um"] = (("torque", "phase"), error)
    states = {"start": _spur(), "optimised": model}
    groups = {
        "": found,
        "pair": pair_dataset.pair_dataset(model.pair),
        "axes": pair_dataset.axes_dataset(model.pair),
        "sliding": pair_dataset.sliding_dataset(model.pair, 0.99, 0.05, 900.0),
        "modification": pair_dataset.modification_dataset(
            {name: (it.pair, it.flanks) for name, it in states.items()}
        ),
    }
    if "bearing_load_N" in found:
        groups["shafts"] = _shafts.shafts_dataset(model, cycle, _bearings(found), {})
    return {name: each.assign_attrs(title="case") for name, each in groups.items()}


_TORQUES = np.asarray([20.0, 40.0, 60.0])
_TORQUE = {"long_name": "torque on the pinion", "units": "N m"}


def _bearings(dataset):
    """As in the summary."""
    load = np.tensordot(dataset["weight"].values, dataset["bearing_load_N"].values, 1)
    owners = [("pinion", 0), ("pinion", 1), ("wheel", 0), ("wheel", 1)]
    return [
        {"gear": gear, "index": index, "load_N": dict(zip("STZ", row, strict=True))}
        for (gear, index), row in zip(owners, load, strict=True)
    ]


def _sized(keys):
    """Three combinations of amounts at three torques."""
    size = np.linspace(1.0, 3.0, 9).reshape(3, 3)
    over = ("combination", "torque")
    about = {"long_name": "peak to peak of the transmission error", "units": "um"}
    amounts = {key: ("combination", [10.0, 0.0, 5.0], about) for key, about in keys.items()}
    return xr.Dataset(
        {"te_peak_to_peak_um": (over, size, about), "max_pressure_MPa": (over, size), **amounts},
        {"torque_pinion_Nm": ("torque", _TORQUES, _TORQUE), "amount": list(keys)},
        {"title": "sized"},
    )


_AMOUNTS = {
    "depth_um": {"units": "um", "long_name": "both: depth"},
    "extent": {"units": "1", "long_name": "both: extent"},
}


@pytest.fixture(scope="module")
def everything(groups):
    """Every picture by its case and name, its figure and its tables."""
    return [
        (f"{case} {each.name}", each.draw(), {"": each.table, **each.beside})
        for case in ("mounted", "relieved")
        for each in plot.pictures(groups[case])
    ]


def test_sizing_is_a_map_of_one_amount_and_ranks_of_several():
    from jaxgear.plot._sizing_pictures import sizing

    one = sizing(_sized({"depth_um": _AMOUNTS["depth_um"]}))
    assert one.axes[0].get_xlabel() == "both: depth [µm]"
    several = sizing(_sized(_AMOUNTS))
    words = [text.get_text() for text in several.axes[0].get_xticklabels()]
    assert words == ["both: depth [µm]", "both: extent [-]"]
    assert [each.get_xlabel() for each in several.axes[1:3]] == [
        "peak to peak of the TE [µm]",
        "largest flank pressure [MPa]",
    ]


def test_every_table_of_a_picture_is_one_table(everything, tmp_path):
    names = {name.partition(" ")[2] for name, *_ in everything}
    assert names >= {"gear_pair", "axes", "modification", "sliding", "harris_map", "te_spectrum"}
    assert names >= {"transmission_error", "mesh_stiffness", "flank_maps", "face_load", "shafts"}
    for name, _, held in everything:
        for key, table in held.items():
            write_csv(table, tmp_path / f"{name}_{key}.csv")
            assert len(assert_table(tmp_path / f"{name}_{key}.csv"))


def test_axes_say_quantity_and_unit(everything):
    for name, figure, _ in everything:
        assert figure.get_suptitle(), name
        for axes in (each for each in figure.axes if each.axison):
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
    for name, figure, held in everything:
        if not name.startswith("mounted"):
            continue
        columns = held[""]
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
    for _, _, held in everything[4:8]:
        columns = held[""]
        save(Figure, columns, Folder(tmp_path, pictures=False), "picture")
        table = tmp_path / "picture.csv"
        with table.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
        assert rows[0] == list(columns)
        for index, values in enumerate(columns.values()):
            read = [float(row[index]) for row in rows[1:] if row[index]]
            np.testing.assert_allclose(read, values, rtol=1e-9, atol=1e-300)


def test_the_same_picture_is_the_same_file(datasets, tmp_path):
    written = []
    for _ in range(2):
        figure = pictures.transmission_error(datasets["spur"])
        written.append([path.read_bytes() for path in _saved(figure, {}, tmp_path)])
    assert written[0] == written[1]


def _drawn_pair(model: jg.PairModel) -> Figure:
    return gear_pair(pair_dataset.pair_dataset(model.pair).assign_attrs(title="pair"))


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
    figure = _drawn_pair(model)
    pitch_point = np.asarray([[float(model.pair.working_pitch_radius[0]) / jg.mm, 0.0]])
    for body in ("pinion", "wheel"):
        assert _distance(pitch_point, _drawn(figure, body))[0] * jg.mm < 1e-7


@pytest.mark.parametrize("make", [_spur, _helical])
def test_drawn_teeth_do_not_overlap(make):
    model = make()
    figure = _drawn_pair(model)
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
        radius = np.hypot(*_drawn(_drawn_pair(make()), "pinion").T) * jg.mm
        assert np.min(radius) == pytest.approx(float(pair.root_radius[0]), rel=1e-9)
        assert np.max(radius) == pytest.approx(float(pair.tip_radius[0]), rel=1e-9)


def test_path_of_contact_is_drawn_to_scale():
    model = _spur()
    ends = _drawn(_drawn_pair(model), "path of contact") * jg.mm
    length = float(np.linalg.norm(np.diff(ends, axis=0)))
    assert length == pytest.approx(float(model.pair.path_of_contact), rel=1e-12)
    # A is on the wheel's tip circle and E on the pinion's.
    centre = np.asarray([float(model.pair.working_centre_distance), 0.0])
    assert np.linalg.norm(ends[0] - centre) == pytest.approx(float(model.pair.tip_radius[1]))
    assert np.linalg.norm(ends[1]) == pytest.approx(float(model.pair.tip_radius[0]))


def test_transmission_error_repeats_and_names_its_statistics(datasets):
    dataset = datasets["spur"]
    figure = pictures.transmission_error(dataset)
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


_PHASES = (np.arange(16) + 0.5) / 16


def _harris(torques, phases, error, weight=None):
    weight = np.full(len(phases), 1.0 / len(phases)) if weight is None else weight
    return xr.Dataset(
        {"harris_te_um": (("torque", "phase"), error)},
        {"torque_Nm": ("torque", torques), "phase": phases, "weight": ("phase", weight)},
    )


def test_harris_statistics_by_hand():
    waves = np.asarray([1.0, 2.0, 3.0])[:, None] * (4.0 + np.sin(2 * np.pi * _PHASES))
    columns = tables.harris_map_columns(_harris(_TORQUES, _PHASES, waves))
    np.testing.assert_allclose(columns["te_mean_um"], [4.0, 8.0, 12.0])
    np.testing.assert_allclose(columns["te_rms_um"], np.asarray([1.0, 2.0, 3.0]) / np.sqrt(2.0))
    uneven = tables.harris_map_columns(_harris(_TORQUES[:1], [0.0, 0.5], [[0.0, 1.0]], [0.8, 0.2]))
    np.testing.assert_allclose(uneven["te_mean_um"], 0.2)
    np.testing.assert_allclose(uneven["te_rms_um"], 0.4)


def test_spectrum_by_hand():
    """Orders of sines come out with their amplitudes, between the mesh harmonics too."""
    # Five mesh periods, and an order of a fifth besides the first.
    phases = np.concatenate([_PHASES + period for period in range(5)])
    waves = np.sin(2 * np.pi * phases) + 0.5 * np.sin(0.4 * np.pi * phases)
    waves = np.asarray([1.0, 2.0, 3.0])[:, None] * waves
    found = tables.spectra(_harris(_TORQUES, phases, waves))
    order = found["order"].values
    expected = np.where(np.isclose(order, 1.0), 1.0, np.where(np.isclose(order, 0.2), 0.5, 0.0))
    assert order[0] == 0.2
    for torque, amplitude in enumerate(found["te_order_um"].values):
        np.testing.assert_allclose(amplitude, (torque + 1) * expected, atol=1e-12)


def test_a_long_cycle_is_drawn_once(cycles, datasets):
    """From 0 to its end; each of its tooth pairs by itself; its harmonics are the library's."""
    model, cycle = cycles["mounted"]
    columns = tables.over_cycle(datasets["mounted"], "transmission_error_um")
    assert len(columns["phase"]) == cycle.approach.size
    assert np.all(np.diff(columns["phase"]) > 0.0)
    assert 2.9 < columns["phase"][-1] < 3.0
    amplitudes = jg.harmonic_amplitudes(cycle, jg.transmission_error(model.pair, cycle), 5)
    harmonics = datasets["mounted"]["te_harmonic_um"]
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
    legend = pictures.face_load(dataset).axes[0].get_legend()
    assert legend is not None
    assert any(f"{factor:.3f}" in text.get_text() for text in legend.get_texts())


def test_deflected_lines_carry_the_loads_of_the_bearings(cycles, datasets, groups):
    """Deflection at a bearing times its stiffness is its load; all loads balance."""
    model, _ = cycles["mounted"]
    bearings = _bearings(datasets["mounted"])
    (drawn,) = [each for each in plot.pictures(groups["mounted"]) if each.name == "shafts"]
    lines, rows = drawn.table, drawn.beside["bearings"]
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
    quick(
        1,
        [
            np.append(np.linspace(0.0, 24.0, 6), 100.0),
            np.append(np.linspace(0.0, 40.0, 20), 100.0),
            [0.0, 100.0],
        ],
    ),
)
def test_labels_of_bearings_hide_nothing(at):
    """However close the bearings are; none is moved where there is room."""
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    axes = figure.subplots()
    axes.set(aspect="equal", xlim=(-60.0, 80.0), ylim=(-50.0, 150.0))
    loads = ["\n".join(f"{axis} {-1e5 - i:.0f} N" for axis in "STZ") for i in range(len(at))]
    # On a shaft of 40 mm that carries its gear at 50 mm, above the other one.
    edges = np.full(len(at), 126.0)
    labels = bearing_labels.Labels(loads, np.asarray(at) - 50.0, edges, 1)
    bearing_labels.write_labels(axes, [labels])
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
    row, aside = bearing_labels.label_places(np.asarray([-10.0, -12.0, -40.0, 1.0, 8.0, 14.0]), 9.0)
    assert aside.tolist() == [-1, -1, 0, 1, 1, 1]
    assert row.tolist() == [1, 0, 0, 2, 1, 0]
    # Next to each other on either side of mid-face they need but one row.
    row, aside = bearing_labels.label_places(np.asarray([-1.0, 1.0]), 9.0)
    assert (row.tolist(), aside.tolist()) == ([0, 0], [-1, 1])


def test_deflected_line_of_a_beam_body_is_the_motion_of_its_sections(cycles):
    """The line and the mesh take the same beam, also where the body is of another material."""
    model, _ = cycles["mounted"]
    shaft = model.pinion_support
    body = jg.BeamBody(30 * jg.mm, 68 * jg.mm, jg.Material(poisson=0.45))
    heights = node_heights(shaft, body)
    motion = np.random.default_rng(3).normal(size=6 * len(heights)) * jg.um
    z, *moved = np.asarray(jax.jit(_shafts.line_of_shaft)(shaft, body, motion))
    first = shaft.layout.gear_nodes[0]
    count = _shafts.POINTS_OF_BEAM
    inside = slice(first * count, (first + 1) * count)
    sections = jax.vmap(lambda at: body.section_motion(shaft, at))
    expected = jax.jit(sections)(z[inside]) @ motion[6 * first : 6 * first + 12]
    np.testing.assert_allclose(np.transpose(moved)[inside], expected[:, :2], rtol=1e-9, atol=1e-18)


def test_torques_of_the_side_view_balance(cycles):
    """The wheel's is the pinion's times the ratio of teeth."""
    model, _ = cycles["mounted"]
    assert _shafts.torque_on(model, "pinion") == 300.0
    assert _shafts.torque_on(model, "wheel") == pytest.approx(300.0 * 31 / 25)


def test_configuration_is_left_alone(datasets):
    before = dict(matplotlib.rcParams)
    pictures.flank_maps(datasets["spur"])
    assert dict(matplotlib.rcParams) == before


@pytest.mark.slow
def test_both_files_have_the_layout_that_each_would_have_alone(datasets, tmp_path):
    with house_look():
        figure = pictures.flank_maps(datasets["spur"])
    _saved(figure, {}, tmp_path)
    for ending, dots in (("png", 150), ("svg", "figure")):
        with house_look():
            alone = pictures.flank_maps(datasets["spur"])
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


def test_values_between_decades_are_plain_numbers(tmp_path):
    figure = Figure(figsize=(3.0, 2.0))
    axes = figure.subplots()
    axes.set(yscale="log", ylim=(0.15, 1.5))
    write_picture(lambda: figure, tmp_path / "some.png", tmp_path / "some.svg")
    named = [each.get_text() for each in axes.get_yticklabels(minor=True) if each.get_text()]
    assert {"0.2", "0.4"} <= set(named)
    assert not [text for text in named if "$" in text]


def test_without_pictures_data_is_written_all_the_same(tmp_path):
    draw, columns = Figure, {"a_um": np.asarray([1.0, 2.0])}
    bare, beside = tmp_path / "bare", {"x_um": np.asarray([1.0])}
    bare.mkdir()
    save(draw, columns, Folder(tmp_path), "search", more=beside)
    save(draw, columns, Folder(bare, pictures=False), "search", more=beside)
    names = ["search.csv", "search.png", "search.svg", "search_more.csv"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bare", *names]
    assert sorted(path.name for path in bare.iterdir()) == [names[0], names[3]]
    assert (bare / names[0]).read_bytes() == (tmp_path / names[0]).read_bytes()


@pytest.mark.slow
def test_a_result_is_drawn_again_without_jax(groups, tmp_path):
    """The same files as of the datasets in memory."""
    again = tmp_path / "again"
    shown = {name: groups["mounted"][name] for name in ("pair", "axes", "shafts")}
    write_dataset(xr.Dataset(attrs={"title": "case"}), tmp_path / "result.nc", shown)
    code = (
        "import sys\nfrom jaxgear._cli._main import main\n"
        "code = main(['plot', sys.argv[1], '--out', sys.argv[2], '--quiet'])\n"
        "sys.exit(code or 'jax' in sys.modules)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "result.nc"), str(again)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert {path.stem for path in again.glob("*.png")} == {"gear_pair", "axes", "shafts"}
    (shafts,) = [each for each in plot.pictures(shown) if each.name == "shafts"]
    save(shafts.draw, shafts.table, Folder(tmp_path), "shafts", **shafts.beside)
    for name in ("shafts.svg", "shafts.csv", "shafts_bearings.csv"):
        assert (tmp_path / name).read_bytes() == (again / name).read_bytes()


@pytest.mark.parametrize(
    ("text", "words"),
    [(None, "no such file"), ("schema = 1", "not a result of jaxgear: no netCDF file")],
)
def test_what_is_no_result_is_said(tmp_path, capsys, text, words):
    path = tmp_path / "result.nc"
    if text is not None:
        path.write_text(text)
    assert main(["plot", str(path)]) == 2
    assert words in capsys.readouterr().err


def test_a_result_without_pictures_is_said(tmp_path, capsys):
    path = tmp_path / "result.nc"
    write_dataset(xr.Dataset({"x": 1.0}), path)
    assert main(["plot", str(path)]) == 2
    assert "nothing in it to draw" in capsys.readouterr().err
