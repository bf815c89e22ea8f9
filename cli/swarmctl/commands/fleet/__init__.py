"""The commands of `fleet`: nodes on other hosts are installed, started and stopped over SSH."""
