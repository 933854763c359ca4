"""Several cameras that see one room: where they stand, and one skeleton a person from all of them."""
