// The 16x16 tiles that an ellipse touches, as a span of tiles in each row of tiles (tile_spans.py). One function counts
// and lists. Every product that is added is an explicit fma, so that two pipelines compute the same bits.
const LIMIT_MARGIN: f32 = 0.01;

struct Spans {
    first: i32,
    end: i32,
    extent: f32,
    y_right: f32,
    slope: f32,
    inverse_a: f32,
    c2: f32,
    limit: f32,
    center: vec2<f32>,
}

fn tile_rows(height: u32, center: vec2<f32>, a: f32, b: f32, c: f32, opacity: f32) -> Spans {
    var s: Spans;
    s.limit = max(log2(INVERSE_ALPHA_MIN * opacity), 0.0) + LIMIT_MARGIN;
    s.center = center;
    s.extent = sqrt(s.limit) / c;
    s.inverse_a = 1.0 / a;
    s.slope = -b * s.inverse_a;
    s.y_right = -b * s.extent / sqrt(fma(b, b, c * c));
    s.c2 = c * c;
    let n_rows = f32((height + 15u) / 16u);
    let slack = 1e-6 * (abs(center.y) + s.extent);
    s.first = i32(floor(clamp((center.y - s.extent - slack - 0.5) / 16.0, 0.0, n_rows)));
    s.end = i32(floor(clamp((center.y + s.extent + slack - 0.5) / 16.0, -1.0, n_rows - 1.0))) + 1;
    return s;
}

// First and end of the tiles that the ellipse touches in a row of tiles.
fn tile_span(s: Spans, row: i32, height: u32, columns: u32) -> vec2<i32> {
    let top = f32(row * 16) + 0.5 - s.center.y;
    let bottom = f32(min(row * 16 + 16, i32(height))) - 0.5 - s.center.y;
    let slack_y = 1e-6 * (abs(s.center.y) + s.extent);
    if (bottom < -s.extent - slack_y || top > s.extent + slack_y) {
        return vec2<i32>(0, 0);
    }
    let low = clamp(top - slack_y, -s.extent, s.extent);
    let high = clamp(bottom + slack_y, -s.extent, s.extent);
    var y = clamp(s.y_right, low, high);
    let right = fma(s.inverse_a, sqrt(max(fma(-s.c2 * y, y, s.limit), 0.0)), fma(s.slope, y, s.center.x))
        + 1e-6 * (abs(s.center.x) + abs(s.slope * y));
    y = clamp(-s.y_right, low, high);
    let left = fma(-s.inverse_a, sqrt(max(fma(-s.c2 * y, y, s.limit), 0.0)), fma(s.slope, y, s.center.x))
        - 1e-6 * (abs(s.center.x) + abs(s.slope * y));
    var first = i32(floor(clamp((left - 0.5) / 16.0, 0.0, f32(columns))));
    let last = i32(floor(clamp((right - 0.5) / 16.0, -1.0, f32(columns) - 1.0)));
    if (left - 0.5 - f32(first) * 16.0 > 15.0) {
        first += 1;
    }
    return vec2<i32>(first, max(first, last + 1));
}
