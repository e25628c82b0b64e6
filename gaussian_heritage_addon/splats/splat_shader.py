"""The shader that draws Gaussians in a viewport, with the projection of the engine's rasterizer."""

from __future__ import annotations

import gpu

from ...engine.rasterizer.settings import ALPHA_MAX, INVERSE_ALPHA_MIN, JACOBIAN_MARGIN, RasterSettings

TEXTURE_WIDTH = 4096
"""Texels in a row of the tables: each is a texture, whose rows are the parts of one long list."""

_TABLES = f"""
#define WIDTH {TEXTURE_WIDTH}
vec4 entry(sampler2D list, int number) {{ return texelFetch(list, ivec2(number % WIDTH, number / WIDTH), 0); }}
"""

_VERTEX = """
void main()
{
  // A negative number stands for a Gaussian that is selected.
  float number = entry(order, gl_InstanceID).x;
  float tinted = number < 0.0 ? tint.a : 0.0;
  int row = int((number < 0.0 ? -1.0 - number : number) + 0.5);
  vec4 center = entry(shapes, 3 * row);            // position; opacity
  vec4 first = entry(shapes, 3 * row + 1);         // covariance: xx, xy, xz, yy
  vec4 second = entry(shapes, 3 * row + 2);        // yz, zz; number of the object
  int object = 4 * int(second.z + 0.5);
  // Rows of the matrix from the frame of the object to that of the camera, and the camera in the frame of the object.
  vec4 mx = entry(objects, object), my = entry(objects, object + 1), mz = entry(objects, object + 2);
  vec4 eye_mode = entry(objects, object + 3);      // the camera; 1 where the object was trained anti-aliased
  vec3 eye = eye_mode.xyz;
  vec4 point = vec4(center.xyz, 1.0);
  vec3 p = vec3(dot(mx, point), dot(my, point), dot(mz, point));
  mat3 own = mat3(first.x, first.y, first.z, first.y, first.w, second.x, first.z, second.x, second.y);
  vec2 focal = 0.5 * scale_shift.xy * size;        // pixels at depth 1
  float depth = perspective ? -p.z : 1.0;
  vec2 slope = p.xy / depth;
  vec2 ndc = perspective ? slope * scale_shift.xy - scale_shift.zw : p.xy * scale_shift.xy + scale_shift.zw;
  // Far outside of the picture the projection is linearised at its margin, as in the engine.
  vec2 bound = clamp(ndc, -MARGIN, MARGIN);
  slope = perspective ? (bound + scale_shift.zw) / scale_shift.xy : vec2(0.0);
  vec3 gx = focal.x / depth * (mx.xyz + slope.x * mz.xyz);
  vec3 gy = focal.y / depth * (my.xyz + slope.y * mz.xyz);
  float xx = dot(gx, own * gx) + LOW_PASS, xy = dot(gx, own * gy), yy = dot(gy, own * gy) + LOW_PASS;
  if (eye_mode.w > 0.5) {
    float both = xx * yy - xy * xy;
    center.w *= sqrt(clamp((both - LOW_PASS * (xx + yy - LOW_PASS)) / both, 0.0, 1.0));
  }
  float a = sqrt(xx), b = xy / a, c = sqrt(max(yy - b * b, 1e-9));
  float reach = sqrt(2.0 * log(max(center.w * INVERSE_ALPHA_MIN, 1.0)));
  vec2 offset = reach * vec2(a * corner.x, b * corner.x + c * corner.y);
  float clip_z = (depth_row.x * p.z + depth_row.y) / depth;
  power = vec3(center.w, -0.5 * reach * reach, 0.5 * clip_z + 0.5);
  if (dot_size > 0.0) {
    offset = dot_size * corner;
    power.xy = vec2(1.0, 0.0);
  }
  place = corner;
  gl_Position = vec4(ndc + 2.0 * offset / size, 0.0, 1.0);

  int base = n_coefficients * row;
  vec3 d = normalize(center.xyz - eye);
  float x = d.x, y = d.y, z = d.z;
  vec3 total = 0.5 + 0.28209479177387814 * entry(colors, base).xyz;
  if (n_evaluated >= 4) {
    total += 0.4886025119029199 * (z * entry(colors, base + 2).xyz - y * entry(colors, base + 1).xyz
      - x * entry(colors, base + 3).xyz);
  }
  if (n_evaluated >= 9) {
    total += 1.0925484305920792 * (x * y * entry(colors, base + 4).xyz - y * z * entry(colors, base + 5).xyz
      - x * z * entry(colors, base + 7).xyz);
    total += 0.31539156525252005 * (2.0 * z * z - x * x - y * y) * entry(colors, base + 6).xyz;
    total += 0.5462742152960396 * (x * x - y * y) * entry(colors, base + 8).xyz;
  }
  if (n_evaluated >= 16) {
    total += -0.5900435899266435 * y * (3.0 * x * x - y * y) * entry(colors, base + 9).xyz;
    total += 2.890611442640554 * x * y * z * entry(colors, base + 10).xyz;
    total += -0.4570457994644658 * (4.0 * z * z - x * x - y * y)
      * (y * entry(colors, base + 11).xyz + x * entry(colors, base + 13).xyz);
    total += 0.3731763325901154 * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y) * entry(colors, base + 12).xyz;
    total += 1.445305721320277 * z * (x * x - y * y) * entry(colors, base + 14).xyz;
    total += -0.5900435899266435 * x * (x * x - 3.0 * y * y) * entry(colors, base + 15).xyz;
  }
  color = mix(max(total, 0.0), tint.rgb, tinted);
}
"""

_FRAGMENT = """
void main()
{
  float squared = dot(place, place);
  if (squared >= 1.0) { discard; }
  if (is_hidden && power.z > texture(scene_depth, gl_FragCoord.xy / size).x) { discard; }
  float alpha = min(power.x * exp(power.y * squared), dot_size > 0.0 ? 1.0 : ALPHA_MAX);
  picture = vec4(color * alpha, alpha);
}
"""


def splat_shader() -> gpu.types.GPUShader:
    """Return the shader of the Gaussians.

    Its instances draw a square with the corners ``corner``, (-1, -1) to (1, 1), for each entry of the list ``order``.
    A selected Gaussian has the entry ``-1 - row``; its colour is mixed with ``tint`` by the share ``tint.a``.
    The lists are textures of `TEXTURE_WIDTH` columns. The picture is premultiplied, in sRGB values, as in training.
    """
    info = gpu.types.GPUShaderCreateInfo()
    for slot, name in enumerate(("order", "shapes", "colors", "objects", "scene_depth")):
        info.sampler(slot, "FLOAT_2D", name)
    info.push_constant("VEC4", "scale_shift")
    info.push_constant("VEC2", "size")
    info.push_constant("FLOAT", "dot_size")
    info.push_constant("INT", "n_coefficients")
    info.push_constant("INT", "n_evaluated")
    info.push_constant("BOOL", "perspective")
    info.push_constant("BOOL", "is_hidden")
    info.push_constant("VEC2", "depth_row")
    info.push_constant("VEC4", "tint")
    info.vertex_in(0, "VEC2", "corner")
    between = gpu.types.GPUStageInterfaceInfo("heritage_splats")
    between.smooth("VEC2", "place")
    between.flat("VEC3", "power")
    between.flat("VEC3", "color")
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "picture")
    margin, low_pass = 1.0 + 2.0 * JACOBIAN_MARGIN, RasterSettings().low_pass
    info.define("MARGIN", str(margin))
    info.define("LOW_PASS", str(low_pass))
    info.define("INVERSE_ALPHA_MIN", str(INVERSE_ALPHA_MIN))
    info.define("ALPHA_MAX", str(ALPHA_MAX))
    info.vertex_source(_TABLES + _VERTEX)
    info.fragment_source(_FRAGMENT)
    return gpu.shader.create_from_info(info)


def copy_shader() -> gpu.types.GPUShader:
    """Return the shader that puts the finished picture over the viewport.

    With a ``strength`` below 1, what is in the viewport shines through. The viewport converts linear values to
    sRGB when they are written, which is undone here.
    """
    info = gpu.types.GPUShaderCreateInfo()
    info.sampler(0, "FLOAT_2D", "finished")
    info.push_constant("FLOAT", "strength")
    info.vertex_in(0, "VEC2", "corner")
    between = gpu.types.GPUStageInterfaceInfo("heritage_copy")
    between.smooth("VEC2", "place")
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "picture")
    info.vertex_source("void main() { place = 0.5 * corner + 0.5; gl_Position = vec4(corner, 0.0, 1.0); }")
    info.fragment_source("""
void main()
{
  vec4 own = texture(finished, place);
  if (own.a < 0.002) { discard; }
  vec3 srgb = clamp(own.rgb / own.a, 0.0, 1.0);
  vec3 linear_rgb = mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), step(0.04045, srgb));
  picture = vec4(linear_rgb, own.a * strength);
}
""")
    return gpu.shader.create_from_info(info)
