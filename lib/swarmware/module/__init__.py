"""The API of functional modules: boards, streams, inboxes, requests.

Sockets and mapped memory belong to the node.
"""
