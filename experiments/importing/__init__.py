"""Turn what other people record into the columns of the log contract."""
