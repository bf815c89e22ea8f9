"""The group `new`: folders to begin with, made from the scaffolds of this installation."""
