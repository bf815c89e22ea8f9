"""The commands of `config`: the effective files of a node, and settings that change while it runs."""
