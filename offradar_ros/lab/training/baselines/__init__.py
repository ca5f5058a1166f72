"""Objectives of the methods that ours is compared with, one a file."""
