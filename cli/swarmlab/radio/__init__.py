"""The radio of a lab: a process that forwards the Ethernet frames of the nodes as a radio network would.

What becomes of a frame is decided in `core`; this package has the process, its TAP devices and its orders.
"""
