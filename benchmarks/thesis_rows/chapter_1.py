"""Chapter I: models and results of others, on which the thesis builds."""

from .row import Row

TITLE = "Chapter I: what the thesis builds on"


_INCLINED = "accessory-h1, webs straight and inclined by 10 degrees, at rest and at 4000 rad/s"


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
    Row(
        "text, Lundberg",
        "three-dimensional contact of a band as an alternative",
        cannot="named and not used in the thesis; here cells of a contact line feel each other by "
        "the integral over a half-space, which is no closed form of a band",
    ),
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
    _held(
        "Fig. I-11",
        "Harris map: TE over torque and roll",
        "app/test_pictures.py::test_harris_statistics_by_hand",
        "a picture and a table of every run; mean and RMS by hand",
    ),
    _held(
        "Fig. I-12",
        "TE without load",
        "response/test_transmission.py::test_unloaded_error_is_the_envelope_of_the_pairs_gaps",
        "the envelope of the pairs' gaps",
    ),
    _held(
        "text 2.2.1, 2.2.2",
        "dynamic transmission error, dynamic factor of the mesh and of a pair of teeth",
        "response/test_dynamic_loads.py::test_without_swing_it_is_the_quasi_static_cycle",
        "all of them are the quasi-static ones where nothing swings",
    ),
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
    _held(
        "Fig. I-25, I-26",
        "a turning ring: its frequencies split with the speed",
        "test_fem_prep_verification.py::test_a_rotating_ring",
        "Coriolis forces, softening and stiffening against closed forms; not with a fixed spring",
    ),
    Row(
        "Fig. I-27",
        "dynamic ratio of a solid wheel and of a thin rim: the body alters the tooth load",
        "accessory, accessory-h1, 200 to 3000 rad/s",
        "damped.peaks",
        ("modal: flexible bodies peak at a lower speed than rigid ones",),
        lambda f: (
            "highest ratio "
            f"{f.listed('ratio there', *((x, 'modal') for x in ('rigid', 'H1')))} at "
            f"{f.listed('peak rad/s', *((x, 'modal') for x in ('rigid', 'H1')), form='.0f')} "
            "rad/s, rigid and with a thin web"
        ),
    ),
    _held(
        "Fig. I-28",
        "modes of no and of one circle",
        "test_fem_prep_fourier.py::test_modes_of_the_free_annulus",
        "diameters and circles of a free annulus",
    ),
    Row(
        "Fig. I-29", "calculated against measured frequencies", cannot="no measured wheel is given"
    ),
    _held(
        "Fig. I-30",
        "a wheel under mesh force and rotation",
        "app/test_hybrid_command.py::test_the_whole_grid_is_in_balance",
        "displacements of the whole grid balance tooth loads, bearings and rotation",
    ),
    Row(
        "Fig. I-31",
        "a straight centred web centres the pressure, an inclined one overloads an edge",
        _INCLINED,
        "centred.inclined",
        (
            "a centred web leaves the load's centre within 2 % of half the face of a rigid wheel's",
            "an inclined web moves it by more than 5 %",
            "... and an edge then carries over a tenth more than the mean",
        ),
        lambda f: (
            "centre of the load over half the face "
            f"{f.listed('centre', *((x, 0.0) for x in ('rigid', 'centred', 'inclined')))}: rigid, "
            "centred, inclined"
        ),
    ),
    Row(
        "Fig. I-32",
        "rotation changes the contact by the web's flexibility",
        _INCLINED,
        "centred.inclined",
        ("rotation moves the load of the inclined web most",),
        lambda f: (
            "centre of the load over half the face at 4000 rad/s "
            f"{f.listed('centre', *((x, 4000.0) for x in ('rigid', 'centred', 'inclined')))}: "
            "rigid, centred, inclined"
        ),
    ),
    Row(
        "Fig. I-33, I-34",
        "holes add the period of their passing to that of the mesh",
        "power-holes, case B, at rest",
        "holes.holes",
        ("at rest the holes' passing shows: over 1 % of the RMS of TE",),
        lambda f: (
            f"TE has {f.listed('passing um', ('B', 0.0))} um at the holes' passing, RMS "
            f"{f.listed('TE RMS um', ('B', 0.0))} um"
        ),
    ),
)
