"""One reader a file format; every one returns streams, and none judges what they mean."""
