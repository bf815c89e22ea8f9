"""Video: sends images of a camera, stream or file as H.264 over RTP, and turns received video into images.

The service runs only where it is configured; PyAV (extra `video`) encodes and decodes.
"""
