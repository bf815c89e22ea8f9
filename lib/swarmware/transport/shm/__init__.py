"""Shared memory inside one platform: rings, doorbells, and the removal of files of dead processes.

It has files that are mapped, locked or rung. Higher layers interpret the bytes of a slot (frames, types).
"""
