"""Boards in shared memory: own boards, mirrors of boards of other nodes, and the rules of channels."""
