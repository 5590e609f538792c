"""Chapter I: models and results of others, on which the thesis builds."""

from .row import Row

TITLE = "Chapter I: what the thesis builds on"


def _held(place: str, thesis: str, test: str, shows: str) -> Row:
    return Row(place, thesis, test=f"tests/{test}", shows=shows)


ROWS = (
    _held(
        "Fig. I-3",
        "one or two pairs in mesh: the stiffness over the cycle",
        "contact/test_cells.py::test_mean_stiffness_with_constant_law",
        "contact lines have the mean length of the contact ratio",
    ),
    _held(
        "eq. 1.1, Fig. I-4",
        "Weber's logarithm of the contact",
        "contact/test_tooth.py::test_logarithm_against_the_half_plane",
        "against the half-plane; Young's modulus restored in a_H",
    ),
    Row("text, Lundberg", "three-dimensional contact of a band as an alternative"),
    _held(
        "eq. 1.2, Fig. I-5",
        "Weber and Banaschek: bending, shear, compression",
        "contact/test_compliance.py::test_parts_of_the_pitch_point",
        "each part by hand",
    ),
    _held(
        "eq. 1.3",
        "the foundation as a half-plane",
        "contact/test_tooth.py::test_foundation_by_hand",
        "by hand",
    ),
    _held(
        "eq. 1.4",
        "Sainsot's foundation on a ring",
        "contact/test_ring.py::test_table_of_sainsot_and_of_the_ring",
        "the polynomial and the ring itself; plane-strain elements agree",
    ),
    _held(
        "Fig. I-6, I-7",
        "deviations of profile and lead",
        "flank/test_deviations.py::test_by_hand",
        "shapes by hand; measured ones as tables",
    ),
    _held(
        "Fig. I-8, I-9",
        "pitch errors",
        "flank/test_tolerances.py::test_pitch_errors_are_one_sine",
        "along the normal, cumulative as one sine",
    ),
    _held(
        "Fig. I-10",
        "inclination and deviation of the axes",
        "contact/test_cells.py::test_misalignment_by_moving_the_wheel",
        "gaps of a wheel that is moved",
    ),
    _held(
        "text 2.1.3",
        "unbalance and synchronous excitation",
        "response/test_unbalance.py::test_a_rigid_rotor_whirls_as_jeffcott_says",
        "Jeffcott's rotor",
    ),
    Row("Fig. I-11", "Harris map: TE over torque and roll"),
    _held(
        "Fig. I-12",
        "TE without load",
        "response/test_transmission.py::test_unloaded_error_is_the_envelope_of_the_pairs_gaps",
        "the envelope of the pairs' gaps",
    ),
    Row("text 2.2.1", "dynamic transmission error"),
    Row("text 2.2.2", "dynamic factor of the mesh and of a pair of teeth"),
    Row(
        "Fig. I-13",
        "dynamic factor of root stress, Kubo's rig",
        cannot="the rig's data are not in the text",
    ),
    _held(
        "Fig. I-14, I-15",
        "tip and root relief, crowning, end relief",
        "flank/test_deviations.py::test_by_hand",
        "shapes by hand",
    ),
    _held(
        "Fig. I-16",
        "Master Curve",
        "verification/test_master_curve.py::test_curve_is_the_computed_optimum",
        "of constant stiffness: the closed form is the computed optimum",
    ),
    _held(
        "Fig. I-17",
        "relief lowers the dynamic load over speed",
        "verification/test_thesis_dynamics.py::test_relief_on_the_master_curve_lowers_the_dynamic_ratio",
        "peaks of 3.3 to 3.9 fall to 1.5 to 1.9",
    ),
    _held(
        "Fig. I-18, I-19",
        "spring and mass, torsional pair",
        "dynamics/test_damping.py::test_torsional_pair_is_damped_in_the_mesh_alone",
        "by hand",
    ),
    _held(
        "Fig. I-20",
        "geared rotors on beams and bearings",
        "system/test_beam.py",
        "beams against finer ones, closed forms and limits",
    ),
    _held(
        "Fig. I-21",
        "deviations on the base plane, contact at each step",
        "contact/test_cells.py::test_material_removed_opens_the_gap",
        "gaps of both gears on the base plane",
    ),
    Row("Fig. I-22", "casing modes and noise", cannot="a housing has stiffness but no mass here"),
    _held(
        "Fig. I-23, I-24",
        "pairs of two-dimensional elements",
        "verification/test_plane_strain.py::test_single_pair_on_rings",
        "plane strain as a judge of the tooth",
    ),
    Row("Fig. I-25, I-26", "a turning ring, free and with one spring: eigenvalues over speed"),
    Row("Fig. I-27", "dynamic ratio of a solid wheel and of a thin rim"),
    _held(
        "Fig. I-28",
        "modes of no and of one circle",
        "test_fem_prep_fourier.py::test_modes_of_the_free_annulus",
        "diameters and circles of a free annulus",
    ),
    Row(
        "Fig. I-29", "calculated against measured frequencies", cannot="no measured wheel is given"
    ),
    Row("Fig. I-30", "a wheel under mesh force and rotation"),
    Row("Fig. I-31", "pressure with a centred and an inclined web"),
    Row("Fig. I-32", "pressure and bending stress at speed"),
    Row("Fig. I-33, I-34", "mesh stiffness modulated by holes"),
)
