//! Flags that every verb with a model has, and the numbers that flags take.
use crate::layers::from_mesh::{MAX_LAYER_MM, MIN_LAYER_MM};
use clap::Args as ClapArgs;

/// How a model is placed and cut.
#[derive(ClapArgs, Debug)]
pub(super) struct Model {
    /// Thickness of the layers [default: 0.2]
    #[arg(long, value_name = "MM", value_parser = layer_height)]
    pub(super) layer_height: Option<f64>,
    /// Thickness of the first layer [default: that of the others]
    #[arg(long, value_name = "MM", value_parser = layer_height)]
    pub(super) first_layer_height: Option<f64>,
    /// Turn the model by degrees about the X, then the Y, then the Z axis
    #[arg(long, value_name = "X,Y,Z", value_parser = angles, allow_hyphen_values = true)]
    pub(super) rotate: Option<[f64; 3]>,
    /// Scale the model to this height, after turning it
    #[arg(long, value_name = "MM", value_parser = positive)]
    pub(super) height_mm: Option<f64>,
}

fn number(text: &str) -> Result<f64, String> {
    text.trim().parse::<f64>().ok().filter(|n| n.is_finite()).ok_or_else(|| "it is no number".to_owned())
}

pub(super) fn within(text: &str, fits: impl Fn(f64) -> bool, wanted: &str) -> Result<f64, String> {
    let value = number(text)?;
    if fits(value) { Ok(value) } else { Err(format!("it must be {wanted}")) }
}

fn layer_height(text: &str) -> Result<f64, String> {
    let range = MIN_LAYER_MM..=MAX_LAYER_MM;
    within(text, |mm| range.contains(&mm), &format!("from {MIN_LAYER_MM} to {MAX_LAYER_MM} mm"))
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    within(text, |mm| mm > 0.0, "more than 0")
}

pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    within(text, |mm| mm >= 0.0, "0 or more")
}

pub(super) fn slope(text: &str) -> Result<f64, String> {
    within(text, |deg| (0.0..90.0).contains(&deg), "from 0 to less than 90")
}

fn angles(text: &str) -> Result<[f64; 3], String> {
    let parts: Result<Vec<f64>, String> = text.split(',').map(number).collect();
    parts?.try_into().map_err(|_| "three angles are needed: X,Y,Z".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_within_their_ranges() {
        let check = |found: Result<f64, String>, expect: Option<f64>| assert_eq!(found.ok(), expect);
        check(layer_height("0.2"), Some(0.2));
        check(layer_height("0"), None);
        check(layer_height("1e-9"), None);
        check(layer_height("NaN"), None);
        check(layer_height("-1"), None);
        check(layer_height("1e9"), None);
        check(positive("0"), None);
        check(positive("inf"), None);
        check(slope("90"), None);
        check(slope("0"), Some(0.0));
        assert_eq!(angles("90, -45,0"), Ok([90.0, -45.0, 0.0]));
        assert!(angles("1,2").is_err() && angles("1,2,3,4").is_err() && angles("1,2,x").is_err());
    }
}
