"""Enrolment of a node in a swarm: the token of an invitation, and the sealed messages of node and inviter.

Decisions and bytes only, for both ends; sockets, files and the root key are in `swarmctl.commands.keys`.
"""
