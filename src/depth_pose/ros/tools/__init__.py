"""Programs on topics: play, record, watch, demo."""
