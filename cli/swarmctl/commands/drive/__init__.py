"""The command `drive`: set-points of the keyboard for one vehicle, while its operator has the stick."""
