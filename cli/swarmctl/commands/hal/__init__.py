"""The commands of `hal`: drivers with their timing, and the calibration of motor controllers."""
