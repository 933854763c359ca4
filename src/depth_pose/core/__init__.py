"""What everything else speaks of: skeleton, camera, frames, rotations, settings, errors."""
