// Draws depth_pose_msgs/SkeletonArray as the sensor sees it. Plain functions, in a browser or in node.

const BONES = [
  ["pelvis", "spine"], ["spine", "chest"], ["chest", "neck"], ["neck", "head"],
  ...["left", "right"].flatMap((side) => [
    ["chest", `${side}_shoulder`], [`${side}_shoulder`, `${side}_elbow`], [`${side}_elbow`, `${side}_wrist`],
    ["pelvis", `${side}_hip`], [`${side}_hip`, `${side}_knee`], [`${side}_knee`, `${side}_ankle`],
    [`${side}_ankle`, `${side}_foot`],
  ]),
];

const FIELD = 1.2; // width of the view at a distance of 1, about 62 degrees

// Pixel of a point in the optical frame: x right, y down, z forward, metres.
function project(point, width, height) {
  const focal = width / FIELD;
  return [width / 2 + (focal * point.x) / point.z, height / 2 + (focal * point.y) / point.z];
}

// Lines of one skeleton: pairs of pixels, and the less certain end's confidence.
function boneLines(skeleton, width, height) {
  const joints = new Map(skeleton.joints.map((joint) => [joint.name, joint]));
  return BONES.filter(([a, b]) => joints.has(a) && joints.has(b)).map(([a, b]) => ({
    from: project(joints.get(a).position, width, height),
    to: project(joints.get(b).position, width, height),
    confidence: Math.min(joints.get(a).confidence, joints.get(b).confidence),
  }));
}

// One colour a person, the same while they are followed.
function colourOf(bodyId) {
  const number = parseInt(bodyId.replace(/\D/g, ""), 10) || 0;
  return `hsl(${(number * 137) % 360} 80% 60%)`;
}

function drawFrame(context, frame, width, height) {
  context.clearRect(0, 0, width, height);
  context.lineWidth = 4;
  for (const skeleton of frame.skeletons) {
    context.strokeStyle = colourOf(skeleton.body_id);
    for (const line of boneLines(skeleton, width, height)) {
      context.globalAlpha = 0.2 + 0.8 * line.confidence;
      context.beginPath();
      context.moveTo(...line.from);
      context.lineTo(...line.to);
      context.stroke();
    }
  }
  context.globalAlpha = 1;
}

if (typeof module !== "undefined") module.exports = { BONES, boneLines, colourOf, drawFrame, project };
