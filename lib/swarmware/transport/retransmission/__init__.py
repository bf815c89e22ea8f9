"""Retransmission: items in flight, the window for them, when they count as lost, and which numbers arrived.

Sans-io: time is an argument. It knows no frame, no file and no tree: those who use it name what they send by
keys or numbers, and state the parameters in which they differ as a policy (ADR 74).
"""
