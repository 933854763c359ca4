"""A virtual depth sensor that watches a moving body: recordings with known joints."""
