//! `compress view`.

use super::args::View;
use commands::console::Console;
use compressor::Result;
use compressor::view::{Options, Server, Source, expect_replaceable, page, serve};
use dataset::host::files::{expect_output, write_atomically};
use serde_json::json;

pub(crate) fn view(args: View, console: &Console) -> Result<()> {
    let View { input, bundle, out, scene, no_reference, force, serve: port } = args;
    let options = Options { bundle, scene, no_reference };
    let source = Source::open(&input, &options)?;
    source.doubts.iter().for_each(|doubt| console.warn(doubt));
    if let Some(why) = &source.omitted {
        console.warn(format!("the page has no reference: {why}"));
    }
    if source.scene.is_none() {
        console
            .warn("there is no scene.glb beside the bundle, so the page shows only the atlas; name a geometry file with --scene");
    }
    let mut object = json!({
        "scene": source.scene_name, "bundle": source.bundle, "geometry": source.scene, "cameras": source.cameras,
    });
    if let Some(port) = port {
        let server = Server::bind(port)?;
        console.print(server.url());
        console.say("serving until interrupted (Ctrl-C)");
        object["url"] = json!(server.url());
        console.result(&object)?;
        return serve(&server, source);
    }
    let path = out.unwrap_or_else(|| source.page_path());
    expect_output(&path, "html", "--out")?;
    expect_replaceable(&path, force)?;
    let html = page(&source)?;
    write_atomically(&path, html.as_bytes())?;
    console.say(format!("page: {}", path.display()));
    object["page"] = json!(path);
    object["bytes"] = json!(html.len());
    console.result(&object)
}
