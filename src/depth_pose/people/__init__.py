"""Finding people in a depth image, telling them apart, and following them over time."""
