"""Symbols of ISO 21771-1, ISO 6336-1 and ISO/TR 14179-2 for what a summary names in words.

They are written as in plain text, K_Hbeta for instance. `docs/results.md` says what each is.
"""

# By the key of the summary, without its unit.
SYMBOLS = {
    "centre_distance": "a_w",
    "base_pitch": "p_bt",
    "path_of_contact": "g_alpha",
    "path_AC": "g_f",
    "common_face_width": "b_w",
    "backlash": "j_wt",
    "working_pressure_angle": "alpha_wt",
    "transverse_pressure_angle": "alpha_t",
    "base_helix_angle": "beta_b",
    "profile_contact_ratio": "eps_alpha",
    "overlap_ratio": "eps_beta",
    "total_contact_ratio": "eps_gamma",
    "full_tip_shortening_coeff": "k",
    "tangential_force": "F_t",
    "c_th": "c'_th",
    "c_prime": "c'",
    "c_gamma_alpha": "c_gammaalpha",
    "c_gamma_beta": "c_gammabeta",
    "mesh_force": "F_bn",
    "max_pressure": "sigma_H",
    "face_load_factor": "K_Hbeta",
    "transverse_load_factor": "K_Halpha",
    "dynamic_ratio": "K_v",
    "specific_sliding_lowest_pinion": "zeta_f1",
    "specific_sliding_lowest_wheel": "zeta_f2",
    "sliding_factor_largest": "K_g",
    "mesh_loss_factor": "H_V",
    "mesh_efficiency": "eta",
    "friction_coefficient": "mu_m",
}
_UNITS = ("_mm", "_deg", "_N", "_MPa", "_N_mm_um")


def with_symbol(key: str) -> str:
    """A key of the summary, and its symbol where a standard has one."""
    names = [key, *(key.removesuffix(unit) for unit in _UNITS if key.endswith(unit))]
    # Of a sweep in both directions.
    names += [name.removesuffix(way) for name in names[:1] for way in ("_up", "_down", "_cold")]
    for name in names:
        if name in SYMBOLS:
            return f"{key} ({SYMBOLS[name]})"
    return key
