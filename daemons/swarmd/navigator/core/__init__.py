"""Decisions of the navigator: estimator, planner, controllers, formation; no input, output or clock."""
