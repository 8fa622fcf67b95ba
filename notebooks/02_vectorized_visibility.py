# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#       jupytext_version: 1.19.6
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Vectorized visibility and correspondence
#
# The visible part of the sky is bounded by silhouettes. Vectorized visibility stores these
# boundaries as polygons on the sphere, one for each vertex of the mesh, and integrates the light in
# them by walking along their edges. A boundary is exact to its edges' lengths, not to a map's
# texels; and a walk along 128 edges replaces a sum over 130,000 texels.
#
# This notebook looks at the polygons, integrates light over them, divides triangles where the light
# needs it, and ends with what is new in the method: one polygon inside a triangle that is
# interpolated from its three corners', by correspondence.

# %%
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxvis
from jaxvis.report import beside_errors, draw_correspondence
from jaxvis.sphere import polygons as spherical

scene = jaxvis.load_scene("sphere-on-plane:clearance=0.4,size=8,cells=8,rows=16")
size = (144, 108)
camera = jaxvis.Camera(eye=(4.2, 4.4, 5.4), target=(0.5, 0.6, 0.0), field_of_view=0.6)
surface = jaxvis.trace_surface(scene, camera, size)
mask = np.asarray(surface.mask)

method = jaxvis.VisibilityCorrespondence(vectors=64, resolution=48)
corresponding = method.precompute(scene, progress=False)
visibility = corresponding.polygons
print(f"{len(scene.positions)} vertices, {len(scene.triangles)} triangles")
mean = np.mean(visibility.counts)
print(f"polygons: {visibility.nbytes / 1e6:.2f} MB, {mean:.0f} vectors each")

# %% [markdown]
# ## Polygons
#
# A polygon is a cyclic list of *position vectors* in homogeneous coordinates $q = (x, y, z, w)$.
# With $w = 1$ it is a point of the silhouette that hides the sky from the vertex; with $w = 0$ a
# direction, on the horizon. From a place $s$ near the vertex it is seen towards
#
# $$Q_s = \mathrm{normalize}\bigl((x, y, z) - w\, s\bigr),$$
#
# so that boundaries shift as they should when one moves away from the vertex: a near silhouette
# more than a far one.
#
# Below is a vertex of the plane beside a floating sphere. Left, its sky as rays tell: white where a
# ray leaves the scene. The disc is the equal-area projection of the hemisphere, normal in the
# middle, horizon at the rim. Over it the polygon, in order. It is one closed sequence. Where there
# are several loops, as here along the horizon and around the sphere, a double bridge joins them,
# which is walked in both directions and so cancels.


# %%
def disc(direction):
    """Equal-area view from above of directions over the plane: x to the right, z downwards."""
    scale = 1 / np.sqrt(np.maximum(1 + direction[..., 1], 1e-9))
    return direction[..., 0] * scale, direction[..., 2] * scale


def visible_sky(position, pixels=240):
    """Which directions of the disc leave the scene, from a point of the plane."""
    x, z = np.meshgrid(*2 * [np.linspace(-1, 1, pixels)])
    square = np.minimum(x**2 + z**2, 1)
    reach = np.sqrt(2 - square)
    direction = np.stack([x * reach, 1 - square, z * reach], axis=-1).astype(np.float32)
    inside = x**2 + z**2 < 1
    origin = np.broadcast_to(position + [0, 1e-3, 0], (inside.sum(), 3)).astype(np.float32)
    free = np.full(inside.shape, np.nan)
    free[inside] = ~scene.tracer.occluded(origin, direction[inside])
    return free


def outline(vertex, place):
    """Unit directions of a vertex' polygon as seen from a place, closed."""
    count = int(visibility.counts[vertex])
    seen = np.stack(spherical.seen_from(visibility.vectors[vertex, :, :count], place), axis=-1)
    seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
    return np.concatenate([seen, seen[:1]])


on_plane = np.flatnonzero(np.asarray(visibility.normals)[:, 1] > 0.999)
positions = np.asarray(visibility.positions)
floor = positions[on_plane, 1].min()
on_plane = on_plane[positions[on_plane, 1] < floor + 1e-3]
distance = np.linalg.norm(positions[on_plane][:, [0, 2]], axis=-1)
vertex = on_plane[np.argmin(np.abs(distance - 1.4))]

figure, axes = plt.subplots(1, 2, figsize=(10, 5), layout="constrained")
for axis in axes:
    axis.imshow(visible_sky(positions[vertex]), extent=(-1, 1, 1, -1), cmap="gray", vmin=-1)
    axis.add_patch(plt.Circle((0, 0), 1, fill=False, color="#888888"))
    axis.set_axis_off()
axes[0].set_title("visible sky, by rays")
points = disc(outline(vertex, visibility.positions[vertex]))
axes[1].plot(*points, color="#d6423b", lw=1.2)
order = axes[1].scatter(*points, c=np.arange(len(points[0])), s=14, cmap="viridis", zorder=3)
axes[1].set_title(f"and the polygon of vertex {vertex}")
figure.colorbar(order, ax=axes, label="place in the sequence", shrink=0.8)
plt.show()

# %% [markdown]
# ## Irradiance from a polygon
#
# Stokes' theorem turns the integral over the visible region $A$ into one over its boundary. Under a
# uniform sky of radiance 1 that is Lambert's formula: each edge of angle $\theta_i$ in a plane with
# unit normal $\Gamma_i$ adds
#
# $$E = n \cdot \int_A l \,\mathrm{d}l = \frac{1}{2} \sum_i \theta_i \; n \cdot \Gamma_i .$$
#
# There is a closed form to compare with: a sphere of radius $r$ whose centre is $c$ above the plane
# and $D$ from a point of it takes $F = (r/D)^2\,(c/D)$ of the point's irradiance, so that $E = \pi
# (1 - F)$.

# %%
own = spherical.normalized(spherical.seen_from(visibility.vectors, visibility.positions))
irradiance = np.asarray(spherical.uniform_irradiance(own, visibility.normals))

curve = np.linspace(0, 5.7, 200)
D = np.sqrt(curve**2 + 1.4**2)

plt.figure(figsize=(7, 3.2), layout="constrained")
plt.plot(curve, np.pi * (1 - 1.4 / D**3), color="#222222", label="closed form")
plt.plot(distance, irradiance[on_plane], "o", ms=3, label="polygons at vertices")
plt.xlabel("distance from the point below the sphere")
plt.ylabel("irradiance, radiance 1")
plt.legend()
plt.show()

# %% [markdown]
# ## Light that varies
#
# Under an environment the integrand is $l\, L_e(l)$. A summed-area table over longitude and
# latitude holds its integral below each parallel, so that the region's integral becomes a sum over
# the polygon's edges: an edge that spans the longitudes $\varphi_i$ to $\varphi_{i+1}$ adds what
# lies in this slice between it and a pole. jaxvis cuts each edge in two and takes the trapezoidal
# rule (`integration="split"`); `integration="vsat"` is the paper's rule, in which a factor $\beta$
# between 0 and 1 says where along the slice the light is.
#
# `shading` says where this is done: at every pixel (`"fragment"`), at the mesh's vertices
# (`"vertex"`), or at the vertices of triangles that are divided as the light asks
# (`"tessellated"`). There, an edge is halved $\zeta \Delta$ times, where $\Delta$ tells how much
# blurring the environment changes the light at its ends. $\zeta$ buys quality with evaluations:

# %%
environment = jaxvis.load_environment("sky:elevation=0.7,azimuth=5,sun_radius=0.02")
reference = jaxvis.Reference(error=0.01)
truth = np.asarray(
    reference.shade(
        reference.precompute(scene), reference.light(environment), surface, key=jax.random.key(0)
    )
)

settings = {
    "vertex": {"shading": "vertex"},
    "tessellated, ζ = 1": {"zeta": 1.0},
    "tessellated, ζ = 2": {"zeta": 2.0},
    "fragment": {"shading": "fragment"},
}
images, evaluations = {}, {}
for name, parameters in settings.items():
    vectorized = jaxvis.VectorizedVisibility(vectors=64, resolution=48, **parameters)
    light = vectorized.light(environment)
    images[name] = np.asarray(vectorized.shade(visibility, light, surface))
    evaluations[name] = vectorized.evaluations(visibility, light, surface)

for name, count in evaluations.items():
    print(f"{name:20} {count:7d} polygons integrated")
beside_errors(images, truth, mask, brightness=0.6, columns=5)

# %% [markdown]
# ## Three polygons, or one
#
# Inside a triangle, these images take the barycentric mean of three *radiances*, those of the three
# corners' polygons seen from the place (paper 000, eq. 19):
#
# $$L = \sum_{k=1}^{3} b_k\, L(Q^k_s).$$
#
# Where the corners see different silhouettes, a shadow's edge shows three times, faintly. If one
# knew which vectors of the three polygons belong together, one could interpolate the *vectors*
# instead and integrate once (eq. 21):
#
# $$L = L(Q_s), \qquad
# Q_s = \Bigl\{\mathrm{normalize}\Bigl(\sum_{k=1}^{3} b_k\, q^k_{j_k} - s\Bigr)
# \Bigr\}_{(j_1, j_2, j_3)}.$$
#
# The triples $(j_1, j_2, j_3)$ come from a spherical Voronoi diagram: the vectors of all three
# corners, seen from the triangle's centre, are its sites, coloured by corner, and where cells of
# three colours meet three vectors correspond. A list of triples must go once around each polygon in
# order. Left the list, right the diagram, for a triangle at the vertex from above.

# %%
faces = np.flatnonzero((scene.triangles == vertex).any(axis=1))
chosen = int(faces[~np.asarray(corresponding.separate)[faces]][0])
draw_correspondence(corresponding, chosen)

# %% [markdown]
# Interpolated by its triples, the outline moves across the triangle as one polygon. The pictures
# show the visible sky at three places from one corner to the opposite edge's middle, by rays, and
# the polygon that correspondence gives there.

# %%
corners = scene.triangles[chosen]
starts = np.asarray(corresponding.starts)
triples = np.asarray(corresponding.triples)[starts[chosen] : starts[chosen + 1]]
triples = triples[np.asarray(corresponding.evaluated)[starts[chosen] : starts[chosen + 1]]]
vectors = np.asarray(visibility.vectors)

figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
for axis, share in zip(axes, (0.0, 0.5, 1.0), strict=True):
    weights = np.array([1 - share, share / 2, share / 2])
    place = weights @ positions[corners]
    q = sum(weights[k] * vectors[corners[k]][:, triples[:, k]] for k in range(3))
    seen = np.stack(spherical.seen_from(jnp.asarray(q), jnp.asarray(place)), axis=-1)
    seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
    axis.imshow(visible_sky(place), extent=(-1, 1, 1, -1), cmap="gray", vmin=-1)
    axis.plot(*disc(np.concatenate([seen, seen[:1]])), color="#d6423b", lw=1.2)
    axis.set_title("barycentrics " + ", ".join(f"{w:.2g}" for w in weights))
    axis.set_axis_off()

# %% [markdown]
# The bridge shows that the interpolation is not perfect: where a vector of the horizon at one
# corner corresponds to one of the sphere at another, a sliver near the horizon is lost, which costs
# little because the cosine is small there.
#
# As pictures, at every pixel: one integral where the other takes three, for an image about as good.
# Faces where correspondence would be wrong (`separate`) still take three.

# %%
per_pixel = jaxvis.VisibilityCorrespondence(vectors=64, resolution=48, shading="fragment")
light = per_pixel.light(environment)
one = np.asarray(per_pixel.shade(corresponding, light, surface))
count = per_pixel.evaluations(corresponding, light, surface)
print(f"polygons: vectorized {evaluations['fragment']}, correspondence {count}")
print(f"{np.mean(np.asarray(corresponding.separate)):.1%} of the faces separate")
beside_errors(
    {"vectorized": images["fragment"], "correspondence": one}, truth, mask, brightness=0.6
)

# %% [markdown]
# The plane's triangles are coarse here, so that errors show: both err where silhouettes change
# *between* vertices. `refine=0.02` adds polygons there (see `jaxvis methods`); more `vectors` and a
# higher `resolution` make the polygons themselves more exact.
