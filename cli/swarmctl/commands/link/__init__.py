"""The commands of `link`: neighbours of a platform with the quality of each link."""
