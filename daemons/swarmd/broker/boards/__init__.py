"""Boards in shared memory: those of this node, mirrors of others, and the rules of channels."""
