//! The network, run by `rten`.

use crate::format::TILE;
use crate::host::inputs::expect_file;
use crate::{Error, Result};
use rten::{Model, NodeId, RunOptions, ThreadPool, Value};
use std::fmt::{self, Debug, Display, Formatter};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const SHAPE: [usize; 4] = [1, 3, TILE, TILE];

/// A network of two inputs and one output.
pub(super) struct Network {
    path: PathBuf,
    model: Model,
    inputs: [NodeId; 2],
    output: NodeId,
    /// As many threads as the caller's pool has.
    threads: Arc<ThreadPool>,
}

impl Network {
    pub(super) fn load(path: &Path) -> Result<Self> {
        expect_file(path, "the LPIPS network: an ONNX file written by export_lpips.py")?;
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        let model = Model::load(bytes).map_err(|e| {
            Error::invalid(path.display(), format!("{e}; expected an ONNX file written by export_lpips.py"))
        })?;
        let (inputs, outputs) = (model.input_ids().to_vec(), model.output_ids().to_vec());
        let (&[reference, decoded], &[output]) = (inputs.as_slice(), outputs.as_slice()) else {
            let what = format!(
                "{} inputs and {} outputs; expected two images and one number",
                inputs.len(),
                outputs.len()
            );
            return Err(Error::invalid(path.display(), what));
        };
        let threads = Arc::new(ThreadPool::with_num_threads(rayon::current_num_threads()));
        Ok(Network { path: path.to_owned(), model, inputs: [reference, decoded], output, threads })
    }

    pub(super) fn run(&self, reference: Vec<f32>, decoded: Vec<f32>) -> Result<f64> {
        let fault = |e: &dyn Display| {
            let what = format!("{e}: expected two inputs of 1 × 3 × {TILE} × {TILE} and one number");
            Error::invalid(self.path.display(), what)
        };
        let image = |values| Value::from_shape(&SHAPE, values).map_err(|e| fault(&e));
        let inputs =
            vec![(self.inputs[0], image(reference)?.into()), (self.inputs[1], image(decoded)?.into())];
        let mut options = RunOptions::default();
        options.thread_pool = Some(self.threads.clone());
        let [output] = self.model.run_n(inputs, [self.output], Some(options)).map_err(|e| fault(&e))?;
        let output = output.into_tensor::<f32>().ok_or_else(|| fault(&"the output is not float32"))?;
        match output.into_data()[..] {
            [distance] if distance.is_finite() => Ok(f64::from(distance)),
            [distance] => Err(fault(&format!("the output is {distance}"))),
            ref other => Err(fault(&format!("the output has {} values", other.len()))),
        }
    }
}

impl Debug for Network {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        f.debug_struct("Network").field("path", &self.path).finish_non_exhaustive()
    }
}
