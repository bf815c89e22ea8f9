"""Pure parts of the navigator: estimator, planner, formation keeping, altitude; no input, output or clock."""
