"""What a pixel is: for one person, and in the labels of everybody in a frame."""

BACKGROUND, PERSON, UNKNOWN = 0, 1, 2
"""State of a pixel for one person: free space; the person; hidden by something nearer, or no return."""

HIDDEN = 255
"""Label in the cloud of all people where something nearer than a person, or nothing, returned."""

MOST_LABEL = 254
"""Largest number of a person in a cloud's labels; 0 is free space."""
