"""A virtual depth sensor: recordings of moving bodies with known joints."""
