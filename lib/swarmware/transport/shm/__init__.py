"""Shared memory inside one platform: rings, doorbells, and the removal of what the dead left.

Here live files that are mapped, locked or rung. What the bytes of a slot mean (frames, types) lives above.
"""
