"""What becomes of the columns of a stream, whatever file they are from."""
