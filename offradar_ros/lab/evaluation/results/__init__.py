"""What an evaluation gives, as records, and the files that hold them."""
