#!/usr/bin/env bash
# Two simulated cameras in one room: find where they stand, fuse their people, draw them: rooms.sh [FOLDER]
set -euo pipefail

folder=${1:-room}
depth_pose=${DEPTH_POSE:-depth-pose}
mkdir -p "$folder"
cd "$folder"

# Two recordings of a minute, of unlike sensors; room_true.yaml and .npz hold where the cameras and joints are
$depth_pose simulate --room --people 2 --cameras 2 --seconds "${SECONDS_LONG:-40}" --seed 1 -o room_true.mcap

# Where the cameras stand, from the people who walk about: rig.yaml, and the picture rig.png
$depth_pose calibrate room_true_0.mcap room_true_1.mcap -o rig.yaml

# One skeleton a person, from both cameras
$depth_pose run --rig rig.yaml room_true_0.mcap room_true_1.mcap -o room.mcap

# Drawn into what the second camera sees
$depth_pose overlay room_true_1.mcap room.mcap --rig rig.yaml -o room.png
