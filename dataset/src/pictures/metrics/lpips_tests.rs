use super::*;

#[cfg(not(feature = "lpips"))]
#[test]
fn without_the_feature_it_is_said_how_to_get_it() {
    let message = Lpips::load(Path::new("alex.onnx")).unwrap_err().to_string();
    assert!(message.contains("alex.onnx") && message.contains("--features compressor/lpips"), "{message}");
}

#[cfg(feature = "lpips")]
mod with {
    use super::*;
    use crate::pictures::metrics::compare;

    /// Features of the small network: per feature the weights of R, G and B, and what is added.
    const FEATURES: [([f32; 3], f32); 2] = [([0.5, -1.0, 0.25], 0.125), ([-0.75, 0.5, 1.0], 0.25)];

    /// A file of protocol buffers, by hand.
    #[derive(Default)]
    struct Proto(Vec<u8>);

    impl Proto {
        fn varint(&mut self, mut value: u64) {
            while value >= 128 {
                self.0.push(value as u8 | 128);
                value >>= 7;
            }
            self.0.push(value as u8);
        }

        fn number(mut self, field: u64, value: u64) -> Self {
            self.varint(field << 3);
            self.varint(value);
            self
        }

        fn bytes(mut self, field: u64, bytes: impl AsRef<[u8]>) -> Self {
            self.varint(field << 3 | 2);
            self.varint(bytes.as_ref().len() as u64);
            self.0.extend_from_slice(bytes.as_ref());
            self
        }

        fn part(self, field: u64, part: Proto) -> Self {
            self.bytes(field, part.0)
        }
    }

    fn node(operator: &str, inputs: &[&str], output: &str) -> Proto {
        let node = inputs.iter().fold(Proto::default(), |node, input| node.bytes(1, input));
        node.bytes(2, output).bytes(4, operator)
    }

    /// A convolution of single texels.
    fn convolution(input: &str, output: &str) -> Proto {
        let numbers = |name, numbers: &[u64]| {
            let list =
                numbers.iter().fold(Proto::default().bytes(1, name), |list, &number| list.number(8, number));
            list.number(20, 7)
        };
        node("Conv", &[input, "w", "b"], output)
            .part(5, numbers("strides", &[1, 1]))
            .part(5, numbers("dilations", &[1, 1]))
            .part(5, numbers("pads", &[0; 4]))
    }

    fn weights(name: &str, shape: &[u64], values: &[f32]) -> Proto {
        let tensor = shape.iter().fold(Proto::default(), |tensor, &side| tensor.number(1, side));
        tensor.number(2, 1).bytes(8, name).bytes(9, bytemuck::cast_slice(values))
    }

    fn image(name: &str, shape: &[u64]) -> Proto {
        let dims =
            shape.iter().fold(Proto::default(), |dims, &side| dims.part(1, Proto::default().number(1, side)));
        let tensor = Proto::default().number(1, 1).part(2, dims);
        Proto::default().bytes(1, name).part(2, Proto::default().part(1, tensor))
    }

    /// Mean squared difference of two features, each a weighted sum of the channels and nothing below 0.
    /// `off` is added to the result, which has the shape `[1, 1, 1, values]`.
    fn network(inputs: &[&str], values: usize, off: f32) -> Vec<u8> {
        let shape = [1, 3, TILE as u64, TILE as u64];
        let (rows, added): (Vec<[f32; 3]>, Vec<f32>) = FEATURES.into_iter().unzip();
        let graph = Proto::default()
            .part(1, convolution(inputs[0], "fx"))
            .part(1, convolution(inputs[inputs.len() - 1], "fy"))
            .part(1, node("Relu", &["fx"], "gx"))
            .part(1, node("Relu", &["fy"], "gy"))
            .part(1, node("Sub", &["gx", "gy"], "d"))
            .part(1, node("Mul", &["d", "d"], "dd"))
            .part(1, node("ReduceMean", &["dd"], "mean"))
            .part(1, node("Add", &["mean", "off"], "out"))
            .bytes(2, "small")
            .part(5, weights("w", &[2, 3, 1, 1], rows.as_flattened()))
            .part(5, weights("b", &[2], &added))
            .part(5, weights("off", &[1, 1, 1, values as u64], &vec![off; values]))
            .part(12, image("out", &[1, 1, 1, values as u64]));
        let graph = inputs.iter().fold(graph, |graph, name| graph.part(11, image(name, &shape)));
        Proto::default().number(1, 8).part(7, graph).part(8, Proto::default().number(2, 13)).0
    }

    fn load(bytes: &[u8]) -> Result<Lpips> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("small.onnx");
        std::fs::write(&path, bytes).unwrap();
        Lpips::load(&path)
    }

    /// A tile of 5 × 4 texels on a page of 8 × 6, every fifth texel invalid.
    fn tile() -> (Image, Image, Mask, Rect) {
        let (width, height) = (8, 6);
        let light = |i: usize, k: usize| std::array::from_fn(|c| 100.0 + ((7 * i + 5 * c + k) % 11) as f32);
        let image =
            |k: usize| Image { width, height, texels: (0..48).map(|i| light(i, k * i % 3)).collect() };
        let mask = Mask { width, height, valid: (0..48).map(|i| i % 5 != 0).collect() };
        (image(1), image(0), mask, Rect { x0: 2, y0: 1, x1: 7, y1: 5 })
    }

    #[test]
    fn the_distance_is_what_the_network_computes_in_the_tiles_own_range() {
        let (decoded, reference, mask, rect) = tile();
        let quality = compare(&decoded, &reference, &mask, rect);
        let lpips = load(&network(&["x", "y"], 1, 0.0)).unwrap();
        let found = lpips.distance(&decoded, &reference, &mask, rect, &quality).unwrap().unwrap();

        let least = quality.peak - quality.range;
        let features = |texel: [f32; 3]| {
            let value =
                |c: usize| ((f64::from(texel[c]) - least) / quality.range * 2.0 - 1.0).clamp(-1.0, 1.0);
            FEATURES.map(|(row, added)| {
                ((0..3).map(|c| f64::from(row[c]) * value(c)).sum::<f64>() + f64::from(added)).max(0.0)
            })
        };
        let mut sum = 0.0;
        for y in rect.y0..rect.y1 {
            for i in (y * 8 + rect.x0..y * 8 + rect.x1).filter(|&i| mask.valid[i]) {
                let pairs = features(decoded.texels[i]).into_iter().zip(features(reference.texels[i]));
                sum += pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            }
        }
        let wanted = sum / (2 * TILE * TILE) as f64;
        assert!(wanted > 1e-5 && (found - wanted).abs() < 1e-4 * wanted, "{found} {wanted}");
        // What is not valid does not count.
        let mut other = decoded.clone();
        (0..48).filter(|i| !mask.valid[*i]).for_each(|i| other.texels[i] = [1e9; 3]);
        assert_eq!(lpips.distance(&other, &reference, &mask, rect, &quality).unwrap(), Some(found));
        // Nor has a constant tile a range.
        let constant = compare(&reference, &reference, &mask, Rect { x1: 3, y1: 2, ..rect });
        assert_eq!(lpips.distance(&decoded, &reference, &mask, rect, &constant).unwrap(), None);
    }

    #[test]
    fn files_that_are_no_such_network_are_refused() {
        for (bytes, what) in [
            (b"not a network".to_vec(), "expected an ONNX file"),
            (network(&["x", "y"], 1, 0.5), "expected 0"),
            (network(&["x"], 1, 0.0), "1 inputs and 1 outputs"),
            (network(&["x", "y"], 2, 0.0), "2 values"),
            (network(&["x", "y"], 1, f32::NAN), "NaN"),
        ] {
            let message = load(&bytes).unwrap_err().to_string();
            assert!(message.contains("small.onnx") && message.contains(what), "{message}");
        }
        assert!(matches!(Lpips::load(Path::new("/nowhere.onnx")), Err(Error::Io { .. })));
    }
}
