"""Finding people in a depth image."""

from depth_pose.people.finder import FINDER_JOINTS, FinderConfig, FoundPeople, FoundPerson, PeopleFinder

__all__ = ["FINDER_JOINTS", "FinderConfig", "FoundPeople", "FoundPerson", "PeopleFinder"]
