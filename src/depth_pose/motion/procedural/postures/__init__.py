"""Everyday postures drawn at random: sitting, lying, kneeling, crawling and the like."""
