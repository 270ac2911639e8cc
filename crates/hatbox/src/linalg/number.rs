use bytemuck::Pod;

/// A number that vectors may be stored in; sums are made in double precision.
pub(crate) trait Number: Pod + Send + Sync + Into<f64> {
    /// The number nearest to this one.
    fn nearest(value: f64) -> Self;
}

impl Number for f32 {
    fn nearest(value: f64) -> Self {
        value as Self
    }
}

impl Number for f64 {
    fn nearest(value: f64) -> Self {
        value
    }
}
