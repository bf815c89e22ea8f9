"""The commands `arm`, `disarm` and `kill`: requests to the motors, followed until vehicles show them."""
