"""Grids in files: written here by each format's own documentation, and read back."""

import re
from dataclasses import replace

import meshio
import numpy as np
import pytest

from fem_prep._brick import REFERENCE_NODES
from fem_prep._checks import BodyError
from fem_prep._decks import files_of
from fem_prep._files import read_grid, write_vtu
from fem_prep._grid import EDGES, Grid, merged
from fem_prep._quality import check_grid
from fem_prep._symmetry import rotation_of

SECTORS = 6

# The mid nodes behind the eight corners, each by the two corners (from 0) that it is between. The
# corners are the same everywhere: the bottom turns to the right about the way to the top.
# Abaqus Analysis User's Guide, "Three-dimensional solid element library", 20-node brick.
ABAQUS = "01 12 23 30 45 56 67 74 04 15 26 37"
# MSC/NX Nastran Quick Reference Guide, CHEXA: G9 to G20.
NASTRAN = "01 12 23 30 04 15 26 37 45 56 67 74"
# Gmsh manual, "Node ordering", Hexahedron20.
GMSH = "01 03 04 12 15 23 26 37 45 47 56 67"
# VTK file formats, VTK_QUADRATIC_HEXAHEDRON.
VTK = ABAQUS


@pytest.fixture(scope="module")
def body():
    """A ring of six bricks in metres, with its sets."""
    places = np.concatenate([REFERENCE_NODES + np.array([0, k, 0]) for k in range(SECTORS)])
    radius, angle = 0.02 * (1 + places[:, 0]), 2 * np.pi / SECTORS * places[:, 1]
    along = 0.01 * (places[:, 2] - 0.5)
    all_nodes = np.stack([radius * np.cos(angle), radius * np.sin(angle), along], axis=1)
    nodes, bricks = merged(all_nodes, np.arange(20 * SECTORS).reshape(-1, 20), 1e-9)
    share = np.empty(len(nodes))
    share[bricks.ravel()] = places[:, 0]
    sets = {"rim": np.flatnonzero(share == 1), "seat:bore": np.flatnonzero(share == 0)}
    return Grid(nodes, bricks, sets)


def in_order(bricks, order):
    """Nodes of bricks in a format's order, found by the corners that each is between."""
    places = {frozenset((int(a), int(b))): middle for a, b, middle in EDGES}
    middles = [places[frozenset(map(int, pair))] for pair in order.split()]
    return bricks[:, [*range(8), *middles]]


def labelled(body, order):
    """Points in millimetres with labels, bricks and sets of labels; the last point is loose.

    The labels neither begin at one nor rise with the places of the points in the file.
    """
    labels = 7 + 3 * np.random.default_rng(1).permutation(len(body.nodes) + 1)
    points = np.concatenate([1e3 * body.nodes + np.array([0, 0, 5.0]), [[9, 9, 99]]])
    sets = {name: labels[nodes] for name, nodes in body.sets.items()}
    return labels, points, labels[in_order(body.bricks, order)], sets


def inp(body):
    labels, points, bricks, sets = labelled(body, ABAQUS)
    lines = ["*HEADING", "a ring", "*NODE, NSET=ALL"]
    lines += [
        f"{k}, {x:.9e}, {y:.9e}, {z:.9e}" for k, (x, y, z) in zip(labels, points, strict=True)
    ]
    lines += ["*ELEMENT, TYPE=C3D20R, ELSET=GEAR"]
    for number, brick in enumerate(bricks, start=1):
        words = [str(number), *map(str, brick)]
        lines += [", ".join(words[:16]) + ",", ", ".join(words[16:])]
    for name, label in (("RIM", "rim"), ("BORE", "seat:bore")):
        lines += [f"*NSET, NSET={name}", *(f"{k}," for k in sets[label])]
    return "\n".join(lines) + "\n"


def bdf(body, style):
    """Fields of eight or sixteen characters or free ones, with marks of continuation or not."""
    labels, points, bricks, sets = labelled(body, NASTRAN)
    width, count = (16, 4) if "wide" in style else (8, 8)

    def card(name, *fields):
        rows = [fields[k : k + count] for k in range(0, len(fields), count)]
        mark = "*A" if "wide" in style else "" if style == "short" else "+A"
        heads = [name + "*" * ("wide" in style), *[mark] * (len(rows) - 1)]
        tails = [*[mark] * (len(rows) - 1), ""]
        if "free" in style:
            both = zip(heads, rows, tails, strict=True)
            return [",".join([head, *map(str, row), tail]) for head, row, tail in both]
        return [
            f"{head:8}" + "".join(f"{word!s:{width}}" for word in row) + tail
            for head, row, tail in zip(heads, rows, tails, strict=True)
        ]

    lines = ["SOL 103", "CEND", "SET 3 = " + ", ".join(map(str, sets["rim"][:9])) + ","]
    lines += ["  " + ", ".join(map(str, sets["rim"][9:])), "BEGIN BULK"]
    for label, point in zip(labels, points, strict=True):
        # A real number has a point; where room is short, the E of an exponent is left out.
        wide = [f"{x:.9e}".replace("e", "") for x in point]
        short = [f"{x:.7f}"[:8] for x in point]
        lines += card("GRID", label, "", *(wide if "wide" in style else short))
    for number, brick in enumerate(bricks, start=1):
        lines += card("CHEXA", number, 1, *brick)
    lines += card("SET1", 8, *sets["seat:bore"])
    return "\n".join(line.rstrip() for line in [*lines, "ENDDATA"]) + "\n"


def msh(body):
    labels, points, bricks, _ = labelled(body, GMSH)
    faces = [brick[[1, 2, 6, 5, 9, 18, 13, 17]] for brick in body.bricks]
    bores = [brick[[3, 0, 4, 7, 11, 16, 15, 19]] for brick in body.bricks]
    elements = [f"16 2 1 1 {' '.join(map(str, labels[face]))}" for face in faces]
    elements += [f"16 2 2 2 {' '.join(map(str, labels[face]))}" for face in bores]
    elements += [f"17 2 1 1 {' '.join(map(str, brick))}" for brick in bricks]
    return "\n".join(
        [
            *("$MeshFormat", "2.2 0 8", "$EndMeshFormat"),
            *("$PhysicalNames", "3", '2 1 "Rim"', '2 2 "Bore"', '3 1 "gear"', "$EndPhysicalNames"),
            *("$Nodes", str(len(points))),
            *(f"{k} {x} {y} {z}" for k, (x, y, z) in zip(labels, points, strict=True)),
            *("$EndNodes", "$Elements", str(len(elements))),
            *(f"{k} {element}" for k, element in enumerate(elements, start=1)),
            "$EndElements\n",
        ]
    )


def vtu(body):
    _, points, _, _ = labelled(body, VTK)

    def array(name, kind, values, more=""):
        text = " ".join(map(str, np.ravel(values).tolist()))
        return f'<DataArray type="{kind}" Name="{name}" {more}format="ascii">{text}</DataArray>'

    inside = {name: np.isin(np.arange(len(points)), nodes) for name, nodes in body.sets.items()}
    return "".join(
        [
            '<?xml version="1.0"?><VTKFile type="UnstructuredGrid" version="0.1" ',
            'byte_order="LittleEndian"><UnstructuredGrid>',
            f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{SECTORS}"><PointData>',
            array("RIM", "Int32", inside["rim"].astype(int)),
            array("bore", "Float64", inside["seat:bore"].astype(float)),
            array("height", "Int32", np.arange(len(points))),
            "</PointData><Points>",
            array("Points", "Float64", points, 'NumberOfComponents="3" '),
            "</Points><Cells>",
            array("connectivity", "Int64", in_order(body.bricks, VTK)),
            array("offsets", "Int64", 20 * np.arange(1, SECTORS + 1)),
            array("types", "UInt8", np.full(SECTORS, 25)),
            "</Cells></Piece></UnstructuredGrid></VTKFile>\n",
        ]
    )


FORMATS = {
    "ring.inp": (inp, "rim", "bore"),
    "short.bdf": (lambda body: bdf(body, "short"), "3", "8"),
    "marked.bdf": (lambda body: bdf(body, "marked"), "3", "8"),
    "wide.nas": (lambda body: bdf(body, "wide"), "3", "8"),
    "free.dat": (lambda body: bdf(body, "free"), "3", "8"),
    "wide_free.nas": (lambda body: bdf(body, "wide free"), "3", "8"),
    "ring.msh": (msh, "rim", "bore"),
    "ring.vtu": (vtu, "rim", "bore"),
}
each_format = pytest.mark.parametrize("name", FORMATS)


@pytest.fixture
def write(tmp_path):
    def written(name, text):
        path = tmp_path / name
        path.write_text(text)
        return path

    return written


def cut_out(pattern, text):
    """The first match of a pattern that must be there."""
    found = re.search(pattern, text, re.DOTALL)
    assert found, pattern
    return found[0]


def refused(path, *words, rim: str = "rim", **options):
    with pytest.raises(BodyError) as caught:
        read_grid(path, rim=rim, **options)
    for word in words:
        assert re.search(word, str(caught.value)), f"{word} is not in: {caught.value}"


def assert_same(grid, body, atol):
    """Same bricks at the same places, in the same order of nodes; same sets."""
    assert len(grid.nodes) == len(body.nodes)
    np.testing.assert_allclose(grid.nodes[grid.bricks], body.nodes[body.bricks], atol=atol)
    assert set(grid.sets) == set(body.sets)
    for name, nodes in body.sets.items():
        found = grid.nodes[grid.sets[name]]
        distance = np.linalg.norm(found[:, None] - body.nodes[nodes], axis=2)
        assert len(found) == len(nodes)
        assert distance.min(axis=0).max() < 2 * atol


@each_format
def test_each_format_is_read(name, body, write):
    text, rim, bore = FORMATS[name]
    grid = read_grid(write(name, text(body)), rim=rim, seats={"bore": bore})
    # Eight characters hold tens of millimetres to 1e-4 mm.
    assert_same(grid, body, 1e-11 if name.endswith((".inp", ".nas", ".msh", ".vtu")) else 2e-7)
    check_grid(grid, needs=("rim", "seat:bore"), radius=0.04)


def test_another_unit_of_length(body, write):
    grid = read_grid(write("ring.inp", inp(body)), rim="RIM", length_unit=0.0254)
    np.testing.assert_allclose(np.ptp(grid.nodes[:, 2]), 0.254, rtol=1e-9)
    np.testing.assert_allclose(grid.nodes[:, 2].min(), -0.127, rtol=1e-9)
    refused(write("ring.inp", inp(body)), "`length_unit`", length_unit=0)


@each_format
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.9])
def test_a_file_cut_short_is_refused_quietly(name, share, body, write, capfd):
    text, rim, bore = FORMATS[name]
    whole = text(body)
    path = write(name, whole[: int(share * len(whole))])
    with pytest.raises(BodyError):
        check_grid(read_grid(path, rim=rim, seats={"bore": bore}))
    assert capfd.readouterr() == ("", "")


@each_format
def test_what_is_no_grid_is_refused(name, tmp_path, write):
    refused(tmp_path / name, "There is no file")
    refused(write(name, ""), "is empty")
    refused(write(name, "Dear Sir,\nplease find 17 bricks\n"), name)
    (tmp_path / f"folder_{name}").mkdir()
    refused(tmp_path / f"folder_{name}", "is a folder")
    (tmp_path / name).write_bytes(bytes(range(256)) * 5)
    refused(tmp_path / name, name)


def test_another_ending(write):
    refused(write("ring.stl", "solid"), r"\.inp, \.bdf, .*\.vtu, got '.*ring\.stl'")


@each_format
def test_a_missing_set_tells_those_that_are_there(name, body, write):
    text, rim, _ = FORMATS[name]
    near = [f"Did you mean '{rim}'"] if rim == "rim" else []
    path = write(name, text(body))
    refused(path, "no set of nodes named 'rime'", *(re.compile(n, re.I) for n in near), rim="rime")
    refused(path, rf"(?i)'{rim}' \(30 nodes\)", rim="nothing like it")


def test_a_set_beside_the_bricks(body, write):
    loose = labelled(body, ABAQUS)[0][-1]
    path = write("ring.inp", inp(body) + f"*NSET, NSET=ALONE\n{loose}\n")
    refused(path, "'ALONE' .* has 1 nodes, none of which belongs to a brick", rim="ALONE")


def test_probes(body, write):
    label = labelled(body, ABAQUS)[0][body.sets["rim"][0]]
    path = write("ring.inp", inp(body) + f"*NSET, NSET=P\n{label}\n")
    grid = read_grid(path, rim="rim", probes={"tip": "p"})
    place = grid.nodes[grid.sets["probe:tip"]]
    np.testing.assert_allclose(place, body.nodes[body.sets["rim"][:1]], atol=1e-11)


LINEAR = {
    "linear.inp": "*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D8R\n1," + "1," * 8 + "\n",
    "linear.bdf": "GRID,1,,0.,0.,0.\nCHEXA,1,1,1,1,1,1,1,1\n,1,1\n",
    "linear.msh": "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1\n1 0 0 0\n$EndNodes\n$Elements\n"
    "1\n1 5 2 1 1 1 1 1 1 1 1 1 1\n$EndElements\n",
}


@pytest.mark.parametrize("name", LINEAR)
def test_linear_bricks_are_refused(name, write):
    refused(write(name, LINEAR[name]), "cannot be used, 1 .*besides 0", "mesh again with quadratic")


def test_other_solids_are_counted(body, write):
    more = "*ELEMENT, TYPE=C3D15\n" + "".join(f"{k}," + "7," * 15 + "\n" for k in (91, 92))
    more += "*ELEMENT, TYPE=C3D10M\n93," + "7," * 10 + "\n"
    refused(write("ring.inp", inp(body) + more), "2 C3D15 and 1 C3D10M, besides 6", "sweeping")
    more = "CTETRA,99,1,7,7,7,7\nENDDATA"
    refused(write("b.bdf", bdf(body, "short").replace("ENDDATA", more)), "1 CTETRA, besides 6")


def test_bricks_of_27_nodes_lose_those_of_faces_and_middle(body, tmp_path):
    extra = np.arange(7 * SECTORS).reshape(SECTORS, 7) + len(body.nodes)
    points = np.concatenate([1e3 * body.nodes, np.full((extra.size, 3), 3.0)])
    inside = np.isin(np.arange(len(points)), body.sets["rim"]).astype(int)
    cells: list = [("hexahedron27", np.concatenate([body.bricks, extra], axis=1))]
    meshio.Mesh(points, cells, point_data={"rim": inside}).write(tmp_path / "ring.vtu")
    grid = read_grid(tmp_path / "ring.vtu", rim="rim")
    assert len(grid.nodes) == len(body.nodes)
    np.testing.assert_allclose(grid.nodes[grid.bricks], body.nodes[body.bricks], atol=1e-12)


def test_abaqus_as_people_write_it(body, write):
    """Everything at once that meshio drops or stumbles over."""
    text = inp(body)
    head, elements, sets = re.split(r"(?=\*ELEMENT)|(?=\*NSET, NSET=RIM)", text)
    rows = head.splitlines()
    elements = elements.replace("*ELEMENT, TYPE=C3D20R", "*Element,\n type=c3d20")
    write("bricks.txt", elements)
    text = "\n".join(
        [
            *("** written by hand", *rows[:9], "", "** in the middle", *rows[9:60]),
            *("*Element, Type=SpringA, Elset=Springs", "900, 7", "*Node, nset=Rest", *rows[60:]),
            *("*Include, Input=bricks.txt", sets.strip().replace("NSET=RIM", "nset=part one")),
            *("*Nset, nset=Rim", "part one", "*Nset, nset=few, generate", "10, 60, 6"),
            *("*nset, nset=FEW, GENERATE", "196, 999999999999", "*Node print, nset=few", "U"),
        ]
    )
    path = write("ring.inp", text)
    assert_same(read_grid(path, rim="RIM", seats={"bore": "Bore"}), body, 1e-11)
    few = read_grid(path, rim="rim", seats={"few": "Few"})
    assert_labels(few, "seat:few", body, [*range(10, 61, 6), *range(196, 300)])


def assert_labels(grid, name, body, wanted):
    """The set has those nodes that have one of the wanted labels."""
    labels = labelled(body, ABAQUS)[0][:-1]
    places = body.nodes[np.isin(labels, wanted)]
    found = grid.nodes[grid.sets[name]]
    assert len(found) == len(places) > 1
    distance = np.linalg.norm(found[:, None] - places, axis=2)
    assert distance.min(axis=0).max() < 1e-6


def test_abaqus_parts(body, write):
    head, sets = inp(body).split("*NSET, NSET=RIM")
    head = head.replace("*HEADING\na ring\n", "")
    rim, bore = sets.split("*NSET, NSET=BORE\n")

    def assembled(moved="", more=""):
        return (
            f"*Heading\n*Part, name=Gear\n{head}*Nset, nset=BORE\n7,\n*End Part\n{more}"
            f"*Assembly, name=A\n*Instance, name=Gear-1, part=Gear\n{moved}*End Instance\n"
            "*Node\n7, 1, 2, 3\n*Nset, nset=point\n7,\n"
            f"*Nset, nset=RIM, instance=Gear-1{rim}*Nset, nset=BORE, instance=Gear-1\n{bore}"
            "*End Assembly\n"
        )

    # The assembly may have a set of its own under a name of the part.
    seats = {"bore": "assembly.bore"}
    grid = read_grid(write("ring.inp", assembled()), rim="rim", seats=seats)
    assert_same(grid, body, 1e-11)
    refused(write("ring.inp", assembled("0., 0., 5.\n")), "'Gear-1' is moved")
    two = f"*Part, name=Pin\n{head}*End Part\n"
    refused(write("ring.inp", assembled(more=two)), "several parts .*'GEAR', 'PIN'")
    again = assembled().replace(
        "*Node\n7, 1", "*Instance, name=Two, part=gear\n*End Instance\n*Node\n7, 1"
    )
    refused(write("ring.inp", again), "part 'GEAR' is used twice")


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("*NODE,", "*NODE, SYSTEM=C,", "cylindrical"),
        ("*ELEMENT", "*SYSTEM\n0,0,1\n*ELEMENT", r"line 77: \*SYSTEM"),
        ("*ELEMENT, TYPE=C3D20R", "*ELEMENT, TYPE=C3D20R, INPUT=b.txt", "another file, 'b.txt'"),
        ("*ELEMENT", "*NODE\n7, 1, 2, 3\n*ELEMENT", "node 7 is defined twice"),
        ("*ELEMENT", "*INCLUDE, INPUT=none.txt\n*ELEMENT", "none.txt' cannot be read"),
        ("*ELEMENT", "*INCLUDE, INPUT=ring.inp\n*ELEMENT", "includes itself"),
        ("*NSET, NSET=RIM", "*NSET, NSET=A, GENERATE\n5,\n*NSET, NSET=RIM", "GENERATE takes"),
        ("e+01,", "e+999,", "not finite"),
        ("1, ", "1, x", "a number is expected, got 'x"),
        ("*NSET, NSET=RIM", "*ELEMENT, TYPE=C3D20\n1, 2, 3\n*NSET, NSET=RIM", "20 nodes; 3 num"),
        ("*NSET, NSET=RIM", "*ELEMENT, TYPE=C3D20\n9" + ",6" * 20 + "\n*NSET", "uses node 6, whi"),
    ],
)
def test_abaqus_that_cannot_be_read(old, new, word, body, write):
    text = inp(body)
    assert old in text
    refused(write("ring.inp", text.replace(old, new, 1)), word)


def test_a_deck_that_includes_itself_by_another_name_is_refused(body, write):
    path = write("ring.inp", inp(body))
    again = f"../{path.parent.name}/ring.inp"
    path.write_text(inp(body).replace("*ELEMENT", f"*INCLUDE, INPUT={again}\n*ELEMENT", 1))
    refused(path, "includes itself")
    path.write_text(inp(body).replace("*ELEMENT", "*INCLUDE, INPUT=/dev/zero\n*ELEMENT", 1))
    refused(path, "'/dev/zero' is no file")


def test_nastran_lists(body, write):
    """Lists of the case control (NX Nastran QRG, SET), and the bulk data's; sets by their name."""
    head = (
        "set 1 = 7 thru 40 except 10, 13, 43\nSET 2 = 7 THRU 61 BY 6\n"
        '$HMSET        2        1 "By six"\nSET 5 = 1.5, 2.5\n'
        '$HMSET        1        2 "bricks"\n'
    )
    tail = (
        "SET     11      GRID    LIST\n+       7       THRU    19      EXCEPT  16\n"
        "SET3,12,GRID,7,10,\n,196,THRU,99999999\nSET3,13,PROP,7,10\nENDDATA"
    )
    text = head + bdf(body, "short").replace("ENDDATA", tail)
    path = write("ring.bdf", text)
    wanted = {
        "1": [k for k in range(7, 41) if k not in (10, 13)] + [43],
        "by six": range(7, 62, 6),
        "11": [7, 10, 13, 19],
        "12": [7, 10, *range(196, 300)],
    }
    grid = read_grid(path, rim="3", seats={name: name for name in wanted})
    for name, labels in wanted.items():
        assert_labels(grid, f"seat:{name}", body, labels)
    refused(path, "no set .* '13'", rim="13")
    refused(path, "'5' .* has 0 nodes", rim="5")
    refused(path, "no set .* 'bricks'", rim="bricks")


def test_nastran_without_sections(body, write):
    text = bdf(body, "free")
    sets = cut_out(r"SET 3[^\n]*\n[^\n]*\n", text)
    bulk = text[text.index("BEGIN BULK") + 11 :].replace("ENDDATA\n", "")
    write("points.bdf", bulk)
    text = f"$ a comment\nINCLUDE 'points.bdf'\n{sets}"
    grid = read_grid(write("ring.bdf", text), rim="3", seats={"bore": "8"})
    assert_same(grid, body, 2e-7)


def test_files_of_a_deck_are_all_that_it_includes(tmp_path, write):
    (tmp_path / "parts").mkdir()
    top = write("top.inp", '*HEADING\n*Include, Input="parts/a.inp"\n*INCLUDE, INPUT=b.txt\n')
    first = write("parts/a.inp", "*INCLUDE, INPUT=c.inc\n")
    others = [write("parts/c.inc", "*NODE\n"), write("b.txt", "*NSET, NSET=A\n1\n")]
    assert files_of(top) == [top, first, *others]
    assert files_of(write("top.bdf", "INCLUDE 'b.txt'\n")) == [tmp_path / "top.bdf", others[1]]
    assert files_of(tmp_path / "none.msh") == [tmp_path / "none.msh"]


def rounded(body, digits):
    """The ring as a text file of few digits has it, in millimetres."""
    number = r"-?\d\.\d{9}e[+-]\d\d"
    return re.sub(number, lambda found: f"{float(found[0]):.{digits - 1}e}", inp(body))


def test_digits_that_a_text_file_leaves_out_do_not_spoil_the_symmetry(body, write):
    near = read_grid(write("near.inp", rounded(body, 7)), rim="RIM").nodes
    assert rotation_of(near, SECTORS) is not None
    assert np.all(near[abs(near[:, 1]) < 1e-9, 1] == 0.0)
    want = read_grid(write("exact.inp", inp(body)), rim="RIM").nodes
    assert 0 < abs(near - want).max() < 1e-8
    # As the digits themselves are not symmetric, reading them as they are would not do.
    digits = np.round(1e3 * want, 5) / 1e3
    assert rotation_of(digits, SECTORS) is None


def test_a_body_that_is_not_symmetric_is_left_as_it_is(body, write):
    moved = body.nodes.copy()
    moved[body.sets["rim"][0], 2] += 3e-6
    text = inp(replace(body, nodes=moved))
    nodes = read_grid(write("ring.inp", text), rim="RIM").nodes
    assert rotation_of(nodes, SECTORS) is None
    # One node is 3 um off, and the middle of the rim perhaps half of that.
    heights = np.unique(np.round(nodes[:, 2], 9))
    assert len(heights) == 4
    assert np.diff(heights).min() == pytest.approx(3e-6, abs=1e-9)


def test_nastran_that_cannot_be_read(body, write):
    text = bdf(body, "free")
    grid = cut_out(r"GRID,\d+,,[^\n]*", text)
    other = grid.replace(",,", ",4,", 1)
    refused(write("ring.bdf", text.replace(grid, other)), "coordinate system 4", "basic", rim="3")
    start = cut_out(r"CHEXA,2,[^\n]*\n[^\n]*\n", text)
    less = re.sub(re.escape(start) + r"[^\n]*\n", start, text)
    refused(write("ring.bdf", less), "CHEXA 2 has 14 nodes", rim="3")
    twice = text.replace(grid, grid + "\n" + re.sub("[^,]*,$", "77.,", grid))
    refused(write("ring.bdf", twice), "defined twice", rim="3")


def test_gmsh_groups_without_a_name(body, write):
    text = re.sub(r"\$PhysicalNames.*\$EndPhysicalNames\n", "", msh(body), flags=re.DOTALL)
    grid = read_grid(write("ring.msh", text), rim="surface 1", seats={"bore": "surface 2"})
    assert_same(grid, body, 1e-11)
    lonely = re.sub(r"(?m)^\d+ 17 .*\n", "", text).replace("$Elements\n18", "$Elements\n12")
    refused(write("lonely.msh", lonely), "no solid elements", "physical group")


def test_gmsh_that_says_more_or_less_than_it_should(body, write, capfd):
    text = msh(body)
    # meshio warns of an end that is missing, but has read everything.
    path = write("ring.msh", text.replace("$EndElements\n", ""))
    assert_same(read_grid(path, rim="Rim", seats={"bore": "Bore"}), body, 1e-11)
    assert capfd.readouterr() == ("", "")
    lost = labelled(body, GMSH)[0][0]
    count = len(body.nodes) + 1
    less = re.sub(rf"(?m)^{lost} .* .* .*\n", "", text, count=1)
    less = less.replace(f"$Nodes\n{count}", f"$Nodes\n{count - 1}")
    refused(write("less.msh", less), "nodes that it does not define")


def test_vtu_in_pieces(body, write):
    text = vtu(body)
    piece = cut_out("<Piece.*</Piece>", text)
    refused(write("two.vtu", text.replace(piece, piece + piece)), "2 pieces", "Merge Blocks")
    refused(write("ring.vtu", text), "no set of nodes named 'height'", rim="height")


def test_names_that_differ_in_capitals_only(body, write):
    path = write("ring.vtu", vtu(body).replace('"bore"', '"rim"'))
    grid = read_grid(path, rim="RIM", seats={"bore": "rim"})
    assert_same(grid, body, 1e-11)
    refused(path, "no set of nodes named 'Rim'", "'RIM' .*'rim'", rim="Rim")


def test_what_is_written_for_paraview_is_read_back_exactly(body, tmp_path, capfd):
    random = np.random.default_rng(2)
    count = len(body.nodes)
    fields = {
        "mode 1: 1563 Hz": random.standard_normal((count, 3)),
        "mode 2: 1563 Hz": random.standard_normal((count, 3)),
        "energy": random.standard_normal(count),
        "held": random.random(count) < 0.5,
        "number": np.arange(count),
    }
    path = tmp_path / "modes.vtu"
    write_vtu(path, body, fields)
    mesh = meshio.read(path)
    assert [block.type for block in mesh.cells] == ["hexahedron20"]
    np.testing.assert_array_equal(mesh.points, body.nodes)
    np.testing.assert_array_equal(mesh.cells[0].data, body.bricks)
    assert set(mesh.point_data) == {*fields, *body.sets}
    for name, values in fields.items():
        np.testing.assert_array_equal(mesh.point_data[name], values)
    again = read_grid(path, rim="rim", seats={"bore": "seat:bore"}, length_unit=1.0)
    np.testing.assert_allclose(again.nodes, body.nodes, atol=1e-17)
    for name, nodes in body.sets.items():
        np.testing.assert_array_equal(again.sets[name], nodes)
    assert [file.name for file in tmp_path.iterdir()] == ["modes.vtu"]
    assert capfd.readouterr() == ("", "")


def test_fields_that_do_not_fit(body, tmp_path):
    count = len(body.nodes)

    def refuses(word, path=tmp_path / "a.vtu", **fields):
        with pytest.raises(BodyError, match=word):
            write_vtu(path, body, fields)

    refuses(r"'u' must have the shape \[\d+\] or .*, got \[3, \d+\]", u=np.zeros((3, count)))
    refuses("be real", u=np.zeros(count, complex))
    refuses("same name: rim", rim=np.zeros(count))
    refuses("must end with .vtu", path=tmp_path / "a.vtk")
    refuses("cannot be written: No such file", path=tmp_path / "none" / "a.vtu")
