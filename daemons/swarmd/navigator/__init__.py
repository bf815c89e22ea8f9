"""The navigator, the reference module: state estimation, formation keeping, control, collision avoidance.

The service reads boards and writes set-points; all computation is in `core`.
"""
