"""The commands of `video`: sessions of video, their rates and their ends."""
