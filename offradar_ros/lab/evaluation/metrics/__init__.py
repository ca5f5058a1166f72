"""What is measured, one figure a file; none knows where its numbers came from."""
