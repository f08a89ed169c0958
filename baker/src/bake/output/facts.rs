//! What a bake tells of its geometry, page and light, in words.

use super::outcome::LayerCount;
use crate::atlas::{Atlas, Skipped};
use crate::bake::errors::COUNTED_ERRORS;
use crate::bake::finish::Assembled;
use crate::bake::forecast::density;
use crate::bake::prepare::{Plan, hour};
use crate::bake::rounds::Traced;
use crate::bake::store::Counts;
use crate::geometry::Geometry;
use crate::light::times::extra_times::percent;
use crate::scene::Scene;
use dataset::observe::count;

/// What may be wrong with a scene most of whose texels are of no use.
pub(crate) fn mostly_invalid(plan: &Plan, stored: &Assembled) -> Option<String> {
    let of = |texels: usize| {
        100.0 * texels as f64 / (stored.valid_texels + stored.unlit_texels + stored.buried_texels) as f64
    };
    if plan.layers() == 0 {
        Some(
            "no light: neither sun nor sky nor a lamp shines at any of these times; all frames are black"
                .to_owned(),
        )
    } else if of(stored.unlit_texels) > 50.0 {
        Some(format!(
            "no light was found at {:.0} % of the texels: either their front sides (counter-clockwise) face away from it (`two_sided` or \
             turned faces may help), or it comes by so few paths that it takes more samples",
            of(stored.unlit_texels)
        ))
    } else if of(stored.buried_texels) > 50.0 {
        Some(format!(
            "{:.0} % of the texels lie inside solids: all around them are the backs of one-sided faces. Are faces turned inside out?",
            of(stored.buried_texels)
        ))
    } else {
        None
    }
}

/// The light groups that shine at some time, and at no texel.
pub(crate) fn lightless(scene: &Scene, plan: &Plan, stored: &Assembled) -> Option<String> {
    let names: Vec<String> =
        stored.dark_groups.iter().map(|&g| format!("{:?}", scene.groups[g].name)).collect();
    (plan.layers() > 0 && !names.is_empty()).then(|| {
        format!(
            "no light of {} {} was found at any texel: do its lamps stand inside something, face away, or lie far off (all lengths are \
             in metres)?",
            if names.len() == 1 { "the group" } else { "the groups" },
            names.join(", ")
        )
    })
}

/// Where more than one cell in twenty has a local error over the target, or over 5 % without one: what it
/// comes from, and what to do. `samples`: those of the bake; `is_denoised`: it is, or cannot be.
pub(crate) fn advice(
    scene: &Scene,
    plan: &Plan,
    stored: &Assembled,
    (samples, target): (u32, Option<f64>),
    is_denoised: bool,
) -> Option<String> {
    let (target, is_asked) = (target.unwrap_or(COUNTED_ERRORS[0]), target.is_some());
    let worst = stored.worst.as_ref()?;
    let local = stored.local.1[worst.frame].filter(|local| local.p95 > target)?;
    let (layer, share) = *worst.causes.first()?;
    let first_group = plan.suns.len() + plan.sky_hours.len();
    let cause = if layer < plan.suns.len() {
        "what surfaces reflect of the sun".to_owned()
    } else if layer < first_group {
        "the sky".to_owned()
    } else {
        format!("the light group {:?}", plan.groups[layer - first_group].name)
    };
    let remedy = match layer {
        layer if layer >= first_group => {
            " (light of a lamp behind a shade or around a corner comes by few paths)"
        }
        layer if layer >= plan.suns.len() && scene.portals.is_empty() => {
            " (is it seen through openings that were not found? A [[portal]] in each sends samples there)"
        }
        _ => "",
    };
    // Errors fall with the square root of the samples, and those of denoised light a little more slowly
    // (NUMERICS, "Denoising").
    let power = if is_denoised { 2.4 } else { 2.0 };
    let needed = f64::from(samples) * (local.p95 / target).powf(power);
    let needed = (needed.log2().ceil().exp2() as u64).max(u64::from(samples) + 1);
    let goal = (1e4 * target).round() / 1e2;
    let how = match (is_denoised, is_asked) {
        (false, _) => format!("--denoise auto lowers it; --samples {needed} brings"),
        (true, true) => format!("--samples {needed} without a time limit brings"),
        (true, false) => format!("--samples {needed} or --target-error {goal}% brings"),
    };
    Some(format!(
        "at {} one cell in twenty has a local error over {}; {} of it comes from {cause}{remedy}; {how} 95 % of the texels \
         below {goal} %",
        hour(plan.times[worst.frame].hour),
        percent(local.p95),
        percent(share),
    ))
}

/// The times at which something shines and no light was found. Whether it is shut out or was missed, no
/// estimate can tell.
fn unseen(plan: &Plan, stored: &Assembled) -> Option<String> {
    let is_unseen =
        |&frame: &usize| !plan.layers_of(frame).is_empty() && stored.errors.frame(frame).light <= 0.0;
    let unseen: Vec<usize> = (0..plan.times.len()).filter(is_unseen).collect();
    let first = plan.times.get(*unseen.first()?)?;
    let others = match unseen.len() - 1 {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    Some(format!(
        "no light was found at {}{others}, though something shines then: it is shut out from every texel, or all samples missed it; \
         how wrong these frames are is not known",
        hour(first.hour)
    ))
}

/// The meshes that were not unwrapped because an earlier bake did.
pub fn unwrapped(charts: Counts) -> Option<String> {
    let Counts { made, kept } = charts;
    (kept > 0).then(|| {
        format!("charts kept from an earlier bake or plan: {}; {made} unwrapped", count(kept, "shape"))
    })
}

/// The triangles that got no texels because nobody can see them.
pub fn skipped(atlas: &Atlas) -> Option<String> {
    let Skipped { triangles, of, area } = atlas.skipped;
    (triangles > 0).then(|| {
        format!(
            "skipped: {triangles} of {} that nobody can see, {:.1} % of the area (hidden = \"keep\" gives them texels)",
            count(of, "lightmapped triangle"),
            100.0 * area
        )
    })
}

/// Facts about a finished bake.
pub(crate) fn of_bake(
    geometry: &Geometry,
    atlas: &Atlas,
    plan: &Plan,
    stored: &Assembled,
    traced: &Traced,
    layers: LayerCount,
) -> Vec<String> {
    let page = f64::from(atlas.width) * f64::from(atlas.page_height) * f64::from(atlas.pages);
    let extras = plan.times.iter().filter(|m| m.extra).count();
    let lit = geometry.instances.iter().filter(|i| i.lightmap).count();
    let mut facts = vec![
        format!(
            "{} in {} ({lit} lightmapped); {}, {}",
            count(geometry.triangles.len(), "triangle"),
            if geometry.instances.len() == 1 {
                "1 mesh".to_owned()
            } else {
                format!("{} meshes", geometry.instances.len())
            },
            count(geometry.materials.len(), "material"),
            count(geometry.textures.len(), "texture")
        ),
        format!(
            "{} {} × {} texels, {}, {} texels per metre; charts touch {:.1} % of the texels, {:.1} % are valid",
            if atlas.pages == 1 { "page".to_owned() } else { format!("{} pages of", atlas.pages) },
            atlas.width,
            atlas.page_height,
            count(atlas.charts as usize, "chart"),
            density(atlas.texels_per_metre),
            atlas.utilisation * 100.0,
            stored.valid_texels as f64 / page * 100.0
        ),
        format!(
            "{} marked invalid for lying in solids or mostly beyond a wall",
            count(stored.buried_texels, "texel")
        ),
        format!(
            "{} marked invalid because no sample found light at any time",
            count(stored.unlit_texels, "texel")
        ),
        format!(
            "{} besides the hours asked for, to show both sides of every light switch",
            count(extras, "frame")
        ),
    ];
    if stored.black_texels > 0 && plan.layers() > 0 {
        facts.push(format!(
            "{} valid but black at every time: samples found light only around them; more samples may find it there too",
            count(stored.black_texels, "texel")
        ));
    }
    if let (added @ 1.., Some(after)) = (plan.extra_times.added.len(), plan.extra_times.error_after) {
        facts.push(format!(
            "{} besides, where light of sky and sun changes fast: interpolated linearly between the frames it errs by up to {}",
            count(added, "extra time"),
            percent(after)
        ));
    }
    facts.extend(unseen(plan, stored));
    if !atlas.layouts.is_empty() {
        let sharing = atlas.placements.iter().flatten().filter(|p| p.layout.is_some()).count();
        facts.push(format!("{sharing} instances share {}", count(atlas.layouts.len(), "chart layout")));
    }
    facts.extend(skipped(atlas));
    facts.extend(atlas.notes.iter().cloned());
    if atlas.degenerate > 0 {
        facts.push(format!("{} without area got no texels", count(atlas.degenerate, "triangle")));
    }
    if let Some((edges, before, after)) = &stored.seams {
        facts.push(format!(
            "{} where charts of one surface meet: mean jump {:.2} % of the light there, {:.2} % after stitching (in the \
             brightest frame)",
            count(*edges, "edge"),
            before.mean * 100.0,
            after.mean * 100.0
        ));
    }
    facts.push(format!(
        "{} of light traced, {} kept from an earlier bake",
        count(layers.traced, "layer"),
        layers.reused
    ));
    facts.extend(traced.notes.iter().cloned());
    if traced.out_of_time {
        facts.push(
            "the time limit ended the tracing: other machines, or other days, give other samples".to_owned(),
        );
    }
    if traced.resumed > 0 {
        facts.push(format!("continued an earlier run that had finished {}", count(traced.resumed, "round")));
    }
    facts
}
