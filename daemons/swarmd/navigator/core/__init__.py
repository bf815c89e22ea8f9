"""Sans-io core of the navigator: estimator, planner, formation keeping; no input, output or clock."""
