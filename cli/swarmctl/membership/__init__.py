"""Membership of platforms: the folder of the root, invitations, rosters on their way, the file of hosts.

The commands `keys`, `fleet` and `node` share it; it prints results, and knows no option of theirs.
"""
