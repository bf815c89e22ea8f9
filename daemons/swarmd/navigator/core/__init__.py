"""Decisions of the navigator, without input, output or clock: estimator, planner, controllers, formation."""
