"""A node under systemd on this computer: programs, user, folders, first configuration, units."""
