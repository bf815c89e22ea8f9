"""Membership of platforms: the folder of the root, invitations, distribution of rosters, the file of hosts.

The commands `keys`, `fleet` and `node` share it. It prints results and does not depend on their options.
"""
