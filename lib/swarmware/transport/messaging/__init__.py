"""The post of a process: messages, requests and their answers, to applications here and on other platforms.

ZeroMQ lives here and in the broker's links, nowhere else.
"""
