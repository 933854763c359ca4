"""Several cameras in one room: their calibration, and one skeleton per person from all of them."""
