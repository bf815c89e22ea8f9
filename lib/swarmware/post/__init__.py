"""The post of a process: messages, requests and their answers, to applications here and on other platforms.

ZeroMQ lives here and in the broker's links, nowhere else.
"""

from swarmware.post.post import Gateway, MessageHandler, Post, RequestHandler

__all__ = ["Gateway", "MessageHandler", "Post", "RequestHandler"]
