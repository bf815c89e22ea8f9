"""The API of functional modules: boards, streams, inboxes, requests, and the clocks of their stamps.

Sockets and mapped memory belong to the node.
"""
