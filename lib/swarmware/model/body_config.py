"""The rigid body of an airframe: what all types of airframes have in common."""

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0, le=1e6)]
NotNegative = Annotated[float, msgspec.Meta(ge=0, le=1e6)]
Angle = Annotated[float, msgspec.Meta(ge=-0.5, le=0.5)]
Rate = Annotated[float, msgspec.Meta(ge=50, le=500)]


class BodyConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The rigid body of an airframe."""

    mass_kg: Positive
    """Mass ready for take-off."""
    inertia_kg_m2: tuple[Positive, Positive, Positive]
    """Moments of inertia about the body axes forward, left and up, which are its principal axes."""
    radius_m: Positive
    """Radius of the sphere around the vehicle."""
    hard_landing_m_s: Positive = 1.5
    """Vertical speed at touch-down above which a landing is a collision."""
    drag_n_s_m: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Linear drag of the rotors along the body axes."""
    drag_n_s2_m2: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Quadratic drag of the fuselage along the body axes."""
    turn_drag_n_m_s: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Linear drag of a turn about the body axes."""
    outputs_held_s: Annotated[float, msgspec.Meta(gt=0, le=10)] = 1.0
    """Time without new outputs of the flight controller during which motors and servos keep the last ones;
    after it the motors stop (ADR 69)."""
    rest_pitch_rad: Angle = 0.0
    """Pitch at which it stands, positive with the nose down: on a tail wheel, on the rail of a catapult."""
    slide_m_s2: NotNegative = 0.0
    """Deceleration on the ground after a touch-down at speed, or 0 if it stops at once."""
