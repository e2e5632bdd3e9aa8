"""What tests, benchmarks, long tests and the scripts of the docs share."""
