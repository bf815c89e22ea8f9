"""The navigator, the reference module: state estimation, formation keeping, control, collision avoidance."""
