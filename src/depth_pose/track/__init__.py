"""Who is who over time, zone, whom to follow, what is remembered of one person."""
