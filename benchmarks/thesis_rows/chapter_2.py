"""Chapter II: the model."""

from .row import Row

TITLE = "Chapter II: the model"


def _held(place: str, thesis: str, test: str, shows: str) -> Row:
    return Row(place, thesis, test=f"tests/{test}", shows=shows)


ROWS = (
    _held(
        "eq. 2.1, Fig. II-1, Annex 1",
        "Timoshenko shafts",
        "system/test_beam.py",
        "with rotary inertia, gyroscopics and Cowper's factor, as the thesis's lack",
    ),
    _held(
        "text 1.1a",
        "bearings as stiffness",
        "solve/test_hybrid.py::test_three_bearings_carry_the_mesh_force",
        "loads balance the mesh",
    ),
    _held(
        "Fig. II-2, eq. 2.2",
        "a rigid body",
        "solve/test_hybrid.py::test_a_rigidified_body_is_a_rigid_gear",
        "a rigidified body is a rigid gear",
    ),
    _held(
        "Fig. II-3, II-4",
        "bodies of bricks of 20 nodes",
        "test_fem_prep_assembly.py::test_patch",
        "patch test; closed forms in the same file",
    ),
    _held(
        "Fig. II-5 to II-9, eq. 2.3 to 2.5",
        "Guyan, Craig-Bampton, Herting",
        "test_fem_prep_condense.py::test_free_frequencies",
        "frequencies of the full body",
    ),
    _held(
        "Fig. II-10",
        "kept nodes: rim 3, bearings 6",
        "test_fem_prep_condense.py::test_rigid_rings_stiffen_and_means_do_not",
        "rigid rings or means",
    ),
    _held(
        "Fig. II-11, II-12, eq. 2.6 to 2.9",
        "rigid gear element, cells",
        "interface/test_wrench.py::test_rigid_kinematics_neither_close_nor_open_the_gap",
        "rolling leaves the gap as it is",
    ),
    _held(
        "Fig. II-13, eq. 2.8",
        "initial gaps",
        "contact/test_cells.py::test_gaps_of_both_gears_add",
        "of both gears",
    ),
    _held(
        "Fig. II-14, eq. 2.10",
        "one flexible gear, or both",
        "solve/test_hybrid.py::test_h1_is_the_thesis_s_way",
        "as the thesis's dense equations",
    ),
    _held(
        "Fig. II-15 to II-17, eq. 2.11 to 2.20",
        "two points under each slice",
        "interface/test_roots.py::test_two_points_are_the_thesis_s_connection",
        "with root_points = 2; 12 by default",
    ),
    _held(
        "Fig. II-18 to II-21, eq. 2.21 to 2.27",
        "mortar between slices and bricks passes the patch test",
        "interface/test_roots.py::test_mortar_takes_a_uniform_load_to_rounding",
        "to 7e-15",
    ),
    _held(
        "Fig. II-22",
        "collocation has spikes",
        "interface/test_roots.py::test_collocation_has_spikes",
        "30, 25, 9, 1.6 % with 8, 12, 25, 40 slices",
    ),
    _held(
        "Fig. II-23, eq. 2.28, 2.29",
        "surface functions of 8 nodes",
        "interface/test_roots.py::test_shape_functions_hold_every_quadratic_and_two_cubics",
        "hold every quadratic",
    ),
    _held(
        "Fig. II-24, eq. 2.30",
        "the whole interface",
        "interface/test_roots.py::test_feet_follow_every_rigid_motion",
        "exact for rigid motions",
    ),
    _held(
        "eq. 2.31",
        "mesh stiffness and force",
        "solve/test_contact.py::test_dense_form_equals_the_mesh_coordinates",
        "the dense way and that by mesh coordinates",
    ),
    _held(
        "eq. 2.32, 2.33",
        "equations of motion",
        "dynamics/test_condensed_bodies.py::test_modes_of_a_march_against_all_coordinates_of_the_body",
        "against all coordinates of the body",
    ),
    _held(
        "eq. 2.34 to 2.36",
        "Rayleigh and modal damping by energy",
        "dynamics/test_damping.py::test_rayleigh_ratios_of_the_thesis",
        "ratios of the thesis",
    ),
    _held(
        "text 3.2, eq. 2.37",
        "centrifugal load",
        "test_fem_prep_assembly.py::test_energy_of_a_spinning_disc",
        "energy of a spinning disc",
    ),
    _held(
        "text 3.2, geometry",
        "growth changes the geometry of the mesh by 1 % at most",
        "response/test_factors.py::test_pressure_angle_to_the_leading_order",
        "-0.473 % for 0.1 %",
    ),
    _held(
        "Fig. II-25",
        "two nested loops find the contact",
        "verification/test_failure_atlas.py",
        "where they fail: chapter 14 of the failure atlas; Newton's steps by default",
    ),
    _held(
        "Annex 2, eq. 2.1 to 2.6",
        "Newmark's rule",
        "dynamics/test_march.py::test_second_order",
        "of second order",
    ),
)
