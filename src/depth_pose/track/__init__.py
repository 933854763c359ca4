"""Tracking, zone, selection of people, and the state of each track."""
