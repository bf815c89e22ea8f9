"""The linear hover model of the Yamaha R-50 as it was published, scaled to another mass."""

import math

from swarmware.model.helicopter_airframe import HoverDerivatives

FOOT_M = 0.3048
PUBLISHED = {
    "x_u": -0.0505,
    "y_v": -0.154,
    "l_u": -0.144,
    "l_v": 0.143,
    "l_b": 166.0,
    "m_u": -0.0561,
    "m_v": -0.0585,
    "m_a": 82.6,
    "tau_f_s": 0.046,
    "a_b": -0.189,
    "b_a": 0.368,
    "a_lat": 0.0313,
    "a_lon": -0.1,
    "b_lat": 0.14,
    "b_lon": 0.0138,
    "n_p": -3.53,
    "n_v": 0.0301,
    "n_w": 0.0857,
    "n_r": -4.13,
    "n_ped": 33.1,
    "n_col": -3.33,
    "k_r": 2.16,
    "k_rfb": -8.26,
}
"""Feet, rad, s: Mettler, Tischler, Kanade 1999, table of the parameters in hover."""
Z_W, Z_COL_FT_S2 = -0.614, 45.8
"""Vertical damping and control of the same table."""
R50_KG, R50_RADIUS_M, R50_TIP_M_S = 44.0, 1.535, 91.1 * 1.535


def scale(mass_kg: float) -> float:
    """Ratio of the R-50's length to the length of a similar helicopter with this mass."""
    return math.cbrt(R50_KG / mass_kg)


def froude(mass_kg: float) -> HoverDerivatives:
    """Derivatives of a helicopter with equal accelerations, which is similar by Froude's number.

    Source: Mettler, Tischler, Kanade 2000, CMU-RI-TR-00-03, section on scaling.
    """
    n = scale(mass_kg)
    per_s, per_m_s = math.sqrt(n), n**1.5 / FOOT_M
    factors = {
        **dict.fromkeys(("x_u", "y_v", "n_p", "n_r", "k_rfb"), per_s),
        **dict.fromkeys(("l_u", "l_v", "m_u", "m_v", "n_v", "n_w"), per_m_s),
        **dict.fromkeys(("l_b", "m_a", "n_ped", "n_col"), n),
        "tau_f_s": 1 / per_s,
    }
    return HoverDerivatives(**{name: value * factors.get(name, 1.0) for name, value in PUBLISHED.items()})
