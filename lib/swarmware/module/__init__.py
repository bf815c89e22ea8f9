"""What a functional module holds in its hands: boards, streams, inboxes, requests.

One file a noun; nothing here knows sockets or maps, that is the node's.
"""
