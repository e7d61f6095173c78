"""Analysis of records: pictures of runs."""
