//! Names of parts that tell of light.

/// Words for what shines, in the singular.
const WORDS: &[&str] = &[
    "bulb",
    "candle",
    "chandelier",
    "emission",
    "emissive",
    "emitter",
    "fire",
    "flame",
    "floodlight",
    "glow",
    "headlight",
    "lamp",
    "lantern",
    "led",
    "light",
    "lightbulb",
    "neon",
    "spotlight",
    "streetlamp",
    "streetlight",
];

/// Whether one of the words of a name is a word for what shines. Words end at signs, digits and capitals.
pub(super) fn is_glowing(name: &str) -> bool {
    words(name).iter().any(|word| {
        let is_known = |word: &str| WORDS.contains(&word);
        is_known(word) || word.strip_suffix('s').is_some_and(is_known)
    })
}

/// The words of a name, in small letters: `StreetLamp_01` has `street` and `lamp`.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut was_small = false;
    for c in name.chars() {
        if !c.is_alphabetic() || c.is_uppercase() && was_small {
            words.push(String::new());
        }
        if c.is_alphabetic() {
            words.last_mut().into_iter().for_each(|word| word.extend(c.to_lowercase()));
        }
        was_small = c.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_words_tell_of_light() {
        for name in
            ["Lamp", "StreetLamp_01", "ceiling-lights", "LED.003", "neon sign", "lightbulb", "TV led 2"]
        {
            assert!(is_glowing(name), "{name}");
        }
        for name in
            ["flight deck", "Slightly bent", "pooled", "clamp", "Skylight", "ledge", "delightful", "", "7"]
        {
            assert!(!is_glowing(name), "{name}");
        }
    }
}
