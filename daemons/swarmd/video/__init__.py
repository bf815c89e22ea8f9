"""Video: images of a camera, stream or file as H.264 over RTP, and received video as images again.

Runs only where it is configured; PyAV (extra `video`) encodes and decodes.
"""
