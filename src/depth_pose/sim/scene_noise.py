"""Simulated depth of a room for three families of sensors: structured light, time of flight, stereo.

`depth_pose.sim.noise` spoils pixels one by one, which suffices for one person before a wall. In rooms, most
errors that mislead a people finder are spatially correlated: dark surfaces lose pixels in blobs, edges move
by a pixel or two, and neighbours share errors, because a sensor matches windows. So all errors are drawn as
smooth fields over the image:

- a pixel is lost where the light that returns, albedo cos(angle)^p / z^2, is too little; the limit varies
  in blobs (structured light, time of flight);
- structured light reads displaced pixels, so that edges are ragged (the displaced look-up of
  J. T. Barron and J. Malik, *Intrinsic scene properties from a single RGB-D image*, CVPR 2013, sec. 5),
  errs in disparity, the same amount among neighbours, and has a shadow beside near things;
- it comes in steps of disparity (K. Khoshelham and S. O. Elberink, *Accuracy and resolution of Kinect depth
  data*, Sensors 12, 2012, eq. 6);
- stereo is modelled in `depth_pose.sim.stereo`;
- time of flight mixes the two surfaces at an edge, and its noise grows as the light falls.

The ranges of the parameters are wider than one device's, on purpose. They were set by eye beside
recordings of an Asus Xtion and a Kinect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.sim._scene_kernels import cast_shadow, look_aside, nearest_and_farthest
from depth_pose.sim.fields import smooth_field
from depth_pose.sim.stereo import StereoConfig, measure_stereo

Image = NDArray[np.float32]

FAMILIES = ("structured", "tof", "stereo")
"""Families of depth sensors."""
_FAMILY_SHARES = (0.4, 0.3, 0.3)
"""How often each family is drawn."""
_MATERIALS = 64  # kinds of surface texture, told apart by their albedo
_STEADY, _FLEETING = 0.8, 0.6  # of a video's patches, in deviations: what stays from frame to frame
_DARK = np.float32(0.1)  # reflectance below which surfaces are dark
_EDGE_JUMP = 0.04  # of the depth; a step between neighbours that is an edge


@dataclass(frozen=True)
class Shown:
    """What a camera would see without noise.

    Attributes
    ----------
    depth : (H, W) float32
        Metres; 0 where there is nothing.
    cosine : (H, W) float32
        Of the angle between ray and surface normal.
    albedo : (H, W) float32
        Share of the light that the surface sends back.
    focal : float
        Pixels.
    """

    depth: Image
    cosine: Image
    albedo: Image
    focal: float


@dataclass(frozen=True)
class SceneSensor:
    """A sensor of one family with its parameters.

    Attributes
    ----------
    family : str
        ``structured``, ``tof`` or ``stereo``.
    near, far : float
        Range, metres.
    least_light : float
        Light (albedo cos^p / z^2) below which a pixel is lost, 1/m^2.
    grazing_power : float
        The p of that.
    patchiness : float
        How much the limit varies over the image, natural logarithm.
    baseline : float
        Camera to projector or second camera, metres; negative where it is to the right of the camera.
    raggedness : float
        How far edges move, pixels.
    noise : float
        Standard deviation: of 1/z (1/m) for structured light; of z at 1 m on a white surface
        for time of flight (m).
    step : float
        Structured light: steps of 1/z, 1/m.
    bias : float
        Standard deviation of an error that varies over tens of pixels, share of z.
    edge_loss : float
        Share of edges that are lost.
    flying : float
        Time of flight: share of edge pixels that land between the surfaces.
    stereo : StereoConfig, optional
        Stereo: how it matches, of a camera with `native_focal`.
    native_focal : float
        Stereo: focal length of the images that are matched, pixels.
    ghosts : float
        Share of lost patches that return something far away that is not there.
    vignette : float
        Radius beyond which corners are lost, share of half the diagonal; 2 for none.
    dazzle : float
        Light (albedo / z^2) above which a pixel is lost, 1/m^2.
    materials : int
        Stereo: seed that selects the materials with enough texture to be matched.
    blotches : float
        How much the limit varies more on dark surfaces, natural logarithm.
    texture : (float, float)
        Stereo: mean and deviation of the logarithm of the materials' texture.
    darkness : float
        Stereo: power of the reflectance of dark surfaces in the quality of their match; 0 for none.
    """

    family: str
    near: float
    far: float
    least_light: float
    grazing_power: float
    patchiness: float
    baseline: float
    raggedness: float
    noise: float
    step: float
    bias: float
    edge_loss: float
    flying: float
    stereo: StereoConfig | None
    native_focal: float
    ghosts: float
    vignette: float
    dazzle: float
    materials: int
    blotches: float = 0.0
    texture: tuple[float, float] = (0.3, 0.6)
    darkness: float = 0.0


def sample_sensor(rng: np.random.Generator, family: str | None = None) -> SceneSensor:
    """Draw a sensor, of the given family or a random one."""
    name = family or str(rng.choice(FAMILIES, p=_FAMILY_SHARES))
    tof, stereo = name == "tof", name == "stereo"
    least = np.exp(
        rng.uniform(np.log(0.0003), np.log(0.006)) if tof else rng.uniform(np.log(0.0015), np.log(0.012))
    )
    steps = rng.uniform(0.0022, 0.0034)
    noise = rng.uniform(0.001, 0.006) if tof else rng.uniform(0.15, 0.6) * steps
    return SceneSensor(
        family=name,
        near=rng.uniform(0.2, 0.6),
        far=float(rng.choice([rng.uniform(3.5, 6.0), rng.uniform(6.0, 10.0)], p=[0.3, 0.7])),
        least_light=float(least),
        grazing_power=rng.uniform(0.4, 1.0),
        patchiness=rng.uniform(0.25, 0.7),
        baseline=0.0 if tof else rng.uniform(0.05, 0.09) * float(rng.choice([-1, 1], p=[0.8, 0.2])),
        raggedness=rng.uniform(0.0, 0.4) if tof else rng.uniform(0.4, 1.1),
        noise=noise,
        step=0.0 if tof or stereo else steps,
        bias=rng.uniform(0.0, 0.004),
        edge_loss=rng.uniform(0.0, 0.7),
        flying=rng.uniform(0.2, 0.9) if tof else 0.0,
        stereo=_sample_stereo(rng) if stereo else None,
        native_focal=rng.uniform(350.0, 650.0),
        ghosts=float(rng.choice([0.0, rng.uniform(0.02, 0.3)])),
        vignette=rng.uniform(0.75, 1.05) if tof and rng.random() < 0.4 else 2.0,
        dazzle=np.inf if stereo or rng.random() < 0.85 else rng.uniform(1.0, 4.0),
        materials=int(rng.integers(2**31)),
    )


def _sample_stereo(rng: np.random.Generator) -> StereoConfig:
    """Draw a stereo camera and what its driver does: from raw and full of holes to smooth and filled."""
    return StereoConfig(
        baseline=float(rng.choice([0.05, 0.075, 0.095, 0.12])),
        window=int(rng.integers(5, 22)),
        fattening=rng.uniform(0.2, 0.95),
        thin=rng.uniform(0.0, 0.6),
        error=float(np.exp(rng.uniform(np.log(0.03), np.log(0.3)))),
        blob=rng.uniform(5.0, 30.0),
        step=float(rng.choice([1 / 32, 1 / 16, 1 / 8])),
        lost=rng.uniform(0.0, 0.45),
        edge_loss=float(rng.choice([0.02, rng.uniform(0.02, 0.6)])),
        smoothing=float(rng.choice([0.0, rng.uniform(0.3, 0.9)], p=[0.3, 0.7])),
        smooth_step=float(np.exp(rng.uniform(np.log(0.3), np.log(8.0)))),
        temporal=rng.uniform(0.0, 0.8),
        fill=int(rng.choice(4, p=[0.45, 0.15, 0.25, 0.15])),
        colour_offset=float(rng.choice([0.0, rng.uniform(0.01, 0.06)])) * float(rng.choice([-1, 1])),
    )


def measure(
    shown: Shown, sensor: SceneSensor, rng: np.random.Generator, steady_seed: int | None = None
) -> Image:
    """Measure what is shown.

    Parameters
    ----------
    shown : Shown
    sensor : SceneSensor
    rng : numpy.random.Generator
        Same state, same noise.
    steady_seed : int, optional
        Of the patches that stay where they are in the frames of one video.

    Returns
    -------
    (H, W) float32
        Metres, whole millimetres; 0 where nothing returns.
    """
    if sensor.stereo is not None:
        return _measure_stereo(shown, sensor, sensor.stereo, rng)
    shape = shown.depth.shape
    depth, cosine, albedo = shown.depth, shown.cosine, shown.albedo
    patches = _patches(rng, shape)
    if steady_seed is not None:
        steady = _patches(np.random.default_rng(steady_seed), shape)
        patches = _STEADY * steady + _FLEETING * patches
    lost = _shadow(depth, sensor, shown.focal) if sensor.baseline else np.zeros(shape, bool)
    if sensor.raggedness > 0:
        down, across = (np.float32(sensor.raggedness) * smooth_field(rng, shape, 2.5) for _ in range(2))
        depth, cosine, albedo = (_aside(image, down, across) for image in (depth, cosine, albedo))
    light = albedo * np.maximum(cosine, 0.02) ** sensor.grazing_power / np.maximum(depth, 0.3) ** 2
    near, far = _around(depth)
    edge = far - near > _EDGE_JUMP * far
    if sensor.flying:
        flies = edge & (rng.random(shape, dtype=np.float32) < sensor.flying)
        depth = np.where(flies, near + (far - near) * rng.random(shape, dtype=np.float32), depth)
    uneven = sensor.patchiness * patches
    if sensor.blotches:
        uneven += np.where(albedo < _DARK, np.float32(sensor.blotches), np.float32(0.0)) * patches
    lost |= light < sensor.least_light * np.exp(uneven)
    lost |= edge & (patches > 1.0 - 2.5 * sensor.edge_loss) & ~((sensor.flying > 0) & (patches < 0))
    lost |= albedo > sensor.dazzle * np.maximum(depth, 0.01) ** 2
    noisy = _noisy(depth, light, sensor, rng)
    if sensor.ghosts:
        ghost = lost & (smooth_field(rng, shape, 5.0) > 2.2 - 3.0 * sensor.ghosts)
        noisy = np.where(ghost, rng.uniform(3.5, 7.0) + 0.5 * smooth_field(rng, shape, 20.0), noisy)
        lost &= ~ghost
    gone = (
        lost | (depth <= 0) | (noisy < sensor.near) | (noisy > sensor.far) | _outside(shape, sensor.vignette)
    )
    return np.where(gone, np.float32(0.0), np.rint(noisy * 1000.0) / np.float32(1000.0)).astype(np.float32)


def _measure_stereo(
    shown: Shown, sensor: SceneSensor, stereo: StereoConfig, rng: np.random.Generator
) -> Image:
    """Measure with a stereo camera; the albedo of a material selects its texture."""
    drawn = np.random.default_rng(sensor.materials).normal(*sensor.texture, _MATERIALS)
    texture = np.exp(drawn).astype(np.float32)
    kind = (shown.albedo * 255).astype(np.int64) % _MATERIALS
    slant = np.maximum(shown.cosine, np.float32(0.05)) ** np.float32(0.5 * sensor.grazing_power)
    light = np.asarray(texture[kind] * slant, np.float32)
    if sensor.darkness:
        light *= np.clip(shown.albedo / _DARK, 1e-3, 1.0) ** np.float32(sensor.darkness)
    camera = stereo.scaled(shown.focal / sensor.native_focal)
    depth = measure_stereo(shown.depth, light, shown.focal, camera, rng)
    gone = (depth < sensor.near) | (depth > sensor.far)
    return np.where(gone, np.float32(0.0), np.rint(depth * 1000.0) / np.float32(1000.0)).astype(np.float32)


def _noisy(depth: Image, light: Image, sensor: SceneSensor, rng: np.random.Generator) -> Image:
    shape = depth.shape
    biased = depth * (1.0 + sensor.bias * smooth_field(rng, shape, 30.0))
    if sensor.family == "tof":
        sigma = sensor.noise * np.minimum(0.3 / np.maximum(light, 1e-4), 60.0) ** 0.7
        grain = rng.standard_normal(shape, dtype=np.float32)
        return np.asarray(biased + sigma * (0.8 * grain + 0.5 * smooth_field(rng, shape, 2.0)), np.float32)
    inverse = 1.0 / np.maximum(biased, 0.1) + sensor.noise * smooth_field(rng, shape, 1.7)
    if sensor.step:
        inverse = np.rint(inverse / sensor.step) * sensor.step
    return np.asarray(1.0 / np.maximum(inverse, 0.02), np.float32)


def _patches(rng: np.random.Generator, shape: tuple[int, ...]) -> Image:
    return (
        0.5 * smooth_field(rng, shape, 2.5)
        + 0.5 * smooth_field(rng, shape, 6.0)
        + 0.6 * smooth_field(rng, shape, 16.0)
    )


def _shadow(depth: Image, sensor: SceneSensor, focal: float) -> NDArray[np.bool_]:
    shadow = np.zeros(depth.shape, np.bool_)
    cast_shadow(depth, focal * sensor.baseline, 1.0, shadow)
    return shadow


def _around(depth: Image) -> tuple[Image, Image]:
    """Least and greatest depth of a pixel and its neighbours that have some."""
    low, high = np.empty_like(depth), np.empty_like(depth)
    nearest_and_farthest(depth, low, high)
    return low, high


def _aside(image: Image, down: Image, across: Image) -> Image:
    """Read displaced pixels instead."""
    out = np.empty_like(image)
    look_aside(image, down, across, out)
    return out


def _outside(shape: tuple[int, ...], radius: float) -> NDArray[np.bool_]:
    if radius >= 1.5:
        return np.zeros(shape, bool)
    v = np.arange(shape[0])[:, None] - (shape[0] - 1) / 2
    u = np.arange(shape[1])[None] - (shape[1] - 1) / 2
    return np.hypot(u, v) > radius * np.hypot(shape[0], shape[1]) / 2
