//! Flattening: every file read once, every placed mesh written out in world space.

use super::lamps::lamps;
use super::lights::Groups;
use super::model::{Mesh, Model, NodeMesh, normal_matrix};
use super::motion::index;
use super::movable::{LeftOut, lamps_that_move, moving};
use super::near::unmatched;
use super::notes::{self, Notes};
use super::originals::{self, File};
use super::place::{Placed, Store, count, everything_moves, place, remove_copies, sources};
use super::texture::TextureStore;
use super::{Geometry, Instance, gltf, obj};
use crate::scene::{Object, Scene};
use dataset::{Error, Result};
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3, Vec4};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Most metres across: beyond any scene, and squares of lengths are well within `f32`.
const MAX_EXTENT: f64 = 1e15;
/// Most metres from zero: there double precision still tells 0.1 mm apart.
const MAX_OFFSET: f64 = 1e12;

/// Loads and flattens all objects of a scene. Gives the geometry and the warnings to show.
///
/// # Errors
/// [`Error::Invalid`] and [`Error::Unsupported`] name the file, mesh and vertex; [`Error::Io`] the file.
pub fn load(scene: &Scene) -> Result<(Geometry, Vec<String>)> {
    let mut warnings = Vec::new();
    let geometry = load_with(scene, &mut warnings)?;
    Ok((geometry, warnings))
}

/// [`load`] that gives the warnings also where it fails. It goes on after an error, to tell of all objects.
///
/// # Errors
/// As [`load`]; several are told as one.
pub fn load_with(scene: &Scene, warnings: &mut Vec<String>) -> Result<Geometry> {
    let mut errors = Vec::new();
    let mut notes = Notes::default();
    let mut textures = TextureStore::default();
    let (models, model_of) = read_files(scene, &mut textures, &mut notes, &mut errors);
    let mut groups = Groups::new(scene, &mut textures);
    // Per object, which of its parts fit anything so far.
    let mut matched: Vec<Vec<bool>> = scene.objects.iter().map(|o| vec![false; o.parts.len()]).collect();
    let model_of_object = |file: Option<usize>| file.map(|file| &models[file].1);
    let moving_lamps: Vec<Vec<bool>> = (scene.objects.iter().zip(&model_of).zip(&mut matched))
        .map(|((object, file), matched)| lamps_that_move(object, model_of_object(*file), matched))
        .collect();
    let lamps = lamps(scene, &models, &model_of, &moving_lamps, &mut groups, &mut notes);
    let mut store = Store { textures, ..Store::default() };
    let (mut placed, mut objects, mut left_out) = (Vec::new(), Vec::new(), LeftOut::default());
    for (i, object) in scene.objects.iter().enumerate() {
        let Some(file) = model_of[i] else { continue };
        let (model, matched, lamps) = (&models[file].1, &mut matched[i], &moving_lamps[i]);
        let first = (objects.len(), placed.len());
        let meshes = place(
            object,
            model,
            first.0,
            matched,
            &mut groups,
            scene.bake.albedo_max,
            &mut store,
            &mut placed,
        );
        count(&placed[first.1..], &mut left_out);
        let moving_lamps = model.contents.lamps.iter().zip(lamps).filter(|(_, moves)| **moves);
        let copies = object.world_from_file.len();
        moving_lamps.for_each(|(lamp, _)| left_out.add_lamps(&lamp.name, copies));
        let lamps = if scene.lights.from_file { &lamps[..] } else { &[] };
        let (moving, carried) = moving(object, model, &meshes, lamps, matched);
        for name in carried {
            let what = "is baked, but a joint of a movable mesh carries it, so animations in scene.glb move it away from its baked \
                        shadow; `movable = true` leaves it out of the bake";
            notes.add(&object.file.display().to_string(), "mesh", name, what);
        }
        objects.extend(object.world_from_file.iter().map(|&world_from_file| originals::Object {
            file,
            world_from_file,
            moving: moving.clone(),
        }));
        let unmatched_parts = object.parts.iter().zip(&*matched).filter(|(_, matched)| !**matched);
        errors.extend(unmatched_parts.map(|(part, _)| unmatched(object, part, model)));
    }
    let keeps_motion = motion_to_keep(scene, &models, &model_of, &objects, &mut notes);
    warnings.extend(notes.lines());
    warnings.extend(remove_copies(&mut placed));
    let (file_lights, merged) = groups.finish(scene, lamps, warnings);
    warnings.append(&mut store.undefined);
    warnings.extend(store.warning(scene.bake.albedo_max));
    if errors.is_empty() && placed.iter().all(|p| p.movable) {
        errors.push(everything_moves(&placed));
    }
    if let Some(error) = all_of(errors) {
        return Err(error);
    }
    if let Some(group) = merged {
        let emissions = store.materials.materials.iter_mut().filter_map(|m| m.emission.as_mut());
        emissions.for_each(|emission| emission.group = emission.group.min(group));
    }
    let materials = store.materials.materials.iter().chain(&store.movable.materials);
    let has_emission_maps = materials.clone().any(|m| m.emission.is_some_and(|e| e.map.is_some()));
    let mut geometry = write_out(&placed, has_emission_maps)?;
    geometry.originals.sources = sources(&placed);
    geometry.originals.objects = objects;
    geometry.originals.emission_unit = scene.lights.emission;
    geometry.originals.left_out = left_out;
    geometry.originals.movable_glass = store.movable.take_glass();
    geometry.originals.movable_materials = store.movable.materials;
    let models = models.into_iter().zip(keeps_motion);
    let files = models.map(|((name, model), keeps_motion)| File::new(name, model, keeps_motion));
    geometry.originals.files = files.collect();
    geometry.glass = store.materials.take_glass();
    geometry.materials = store.materials.materials;
    if has_emission_maps {
        geometry.emission_maps = std::mem::take(&mut store.textures.emission().textures);
    }
    geometry.textures = store.textures.textures;
    geometry.lights = file_lights;
    Ok(geometry)
}

/// Several errors as one; a single one as it is.
fn all_of(mut errors: Vec<Error>) -> Option<Error> {
    if errors.len() < 2 {
        return errors.pop();
    }
    let list: String = errors.iter().map(|error| format!("\n  {error}")).collect();
    Some(Error::invalid("the scene's geometry", format!("{} errors:{list}", errors.len())))
}

/// Of each file, whether its skins, animations and deformed meshes are written again: where some of it moves.
/// Animations that are not give a warning.
fn motion_to_keep(
    scene: &Scene,
    models: &[(String, Model)],
    model_of: &[Option<usize>],
    objects: &[originals::Object],
    notes: &mut Notes,
) -> Vec<bool> {
    let keeps = |(number, (_, model)): (usize, &(String, Model))| {
        let of_file = || objects.iter().filter(|object| object.file == number);
        let keeps = of_file().any(|object| !object.moving.nodes.is_empty());
        let object = scene.objects.iter().zip(model_of).find(|(_, file)| **file == Some(number));
        let (Some((object, _)), Some(asset)) = (object, &model.asset) else { return keeps };
        let file = object.file.display().to_string();
        let is_kept = |animation: &&Value| {
            let mut channels = animation["channels"].as_array().into_iter().flatten();
            channels.any(|channel| {
                index(&channel["target"]["node"]).is_some_and(|node| of_file().any(|o| o.moving.has(node)))
            })
        };
        let lost = asset.motion.animations.iter().filter(|animation| !is_kept(animation)).count();
        if lost > 0 {
            let what = "not played: everything stays where its nodes place it. scene.glb keeps only the animations of `movable` nodes";
            notes.add_line(&file, format!("{} {what}", notes::plural(lost, "animation")));
        }
        if let (true, Some(fault)) = (keeps, &asset.motion.fault) {
            let what = "its skins, animations and morph targets cannot be read, so scene.glb has none";
            notes.add_line(&file, format!("{what}: {fault}"));
        }
        keeps && asset.motion.fault.is_none()
    };
    models.iter().enumerate().map(keeps).collect()
}

/// Reads every file once. Gives the names and models, and per object the index of its, if it could be read.
fn read_files(
    scene: &Scene,
    textures: &mut TextureStore,
    notes: &mut Notes,
    errors: &mut Vec<Error>,
) -> (Vec<(String, Model)>, Vec<Option<usize>>) {
    let mut known: BTreeMap<(PathBuf, bool), Option<usize>> = BTreeMap::new();
    let (mut models, mut model_of) = (Vec::new(), Vec::new());
    for object in &scene.objects {
        let key = (object.file.clone(), object.vt_is_lightmap);
        if let Some(&model) = known.get(&key) {
            model_of.push(model);
            continue;
        }
        let index = match read_file(object, textures, notes) {
            Ok(model) => {
                let name = object.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                models.push((name, model));
                Some(models.len() - 1)
            }
            Err(error) => {
                errors.push(error);
                None
            }
        };
        model_of.push(index);
        known.insert(key, index);
    }
    (models, model_of)
}

/// Reads an object's file.
fn read_file(object: &Object, textures: &mut TextureStore, notes: &mut Notes) -> Result<Model> {
    let extension = object.file.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let model = match extension.as_str() {
        "obj" => obj::load(&object.file, object.vt_is_lightmap, textures, notes)?,
        "gltf" | "glb" => gltf::load(&object.file, textures, notes)?,
        _ => {
            let what = format!("{}: expected an .obj, .gltf or .glb file", object.file.display());
            return Err(Error::unsupported(&object.source_line, what));
        }
    };
    let has_triangles = |p: &&NodeMesh| !model.meshes[p.mesh].triangles.is_empty();
    let what = match model.placements.iter().filter(has_triangles).map(|p| p.is_hidden).min() {
        Some(false) => return Ok(model),
        Some(true) => {
            "all of its meshes are hidden (KHR_node_visibility): expected at least one that is visible"
        }
        None => {
            "expected at least one triangle: the file has no faces with an area (points, lines and curves are not baked)"
        }
    };
    Err(Error::invalid(object.file.display(), what))
}

/// Writes all placed meshes that are baked in world space, around the centre of their bounding box.
fn write_out(placed: &[Placed], has_emission_maps: bool) -> Result<Geometry> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (mut vertices, mut triangles) = (0, 0);
    for p in placed {
        for position in world_positions(p) {
            if !position.is_finite() {
                return Err(Error::invalid(&p.name, "its transform leads out of the range of numbers"));
            }
            if p.movable {
                continue;
            }
            (low, high) = (low.min(position), high.max(position));
        }
        if !p.movable {
            triangles += p.mesh.triangles.len();
            vertices += vertex_count(p.mesh);
        }
    }
    if u32::try_from(vertices).is_err() {
        let what = format!("{vertices} vertices after instancing: expected fewer than 2³²");
        return Err(Error::unsupported("the scene's geometry", what));
    }
    if (high - low).max_element() > MAX_EXTENT {
        let what = format!(
            "it spans {} metres: expected {MAX_EXTENT:e} at most; is a `scale` or `translate` in the scene too large?",
            high - low
        );
        return Err(Error::invalid("the scene's geometry", what));
    }
    if (high.abs().max(low.abs()) - (high - low)).max_element() > MAX_OFFSET {
        let what = format!(
            "it lies about {} metres: expected {MAX_OFFSET:e} from zero at most; is a `translate` in the scene too large?",
            0.5 * (low + high)
        );
        return Err(Error::invalid("the scene's geometry", what));
    }
    let mut geometry = Geometry { origin: 0.5 * (low + high), ..Default::default() };
    geometry.positions.reserve_exact(vertices);
    geometry.normals.reserve_exact(vertices);
    geometry.uvs.reserve_exact(vertices);
    geometry.lightmap_uvs.reserve_exact(vertices);
    geometry.triangles.reserve_exact(triangles);
    geometry.material_of.reserve_exact(triangles);
    // Meshes are told apart by where they lie in memory; their numbers go by first appearance, so addresses
    // do not show.
    let mut known: BTreeMap<(*const Mesh, u32, bool), u32> = BTreeMap::new();
    for p in placed.iter().filter(|p| !p.movable) {
        let next = known.len() as u32;
        let number = *known.entry((p.mesh, p.material, p.lightmap)).or_insert(next);
        write_mesh(p, number, has_emission_maps, &mut geometry);
    }
    Ok(geometry)
}

fn world_positions<'a>(p: &'a Placed) -> impl Iterator<Item = DVec3> + 'a {
    let mesh = p.mesh;
    mesh.positions.iter().map(|v| p.world_from_mesh.transform_point3(mesh.origin + v.as_dvec3()))
}

/// Vertices a mesh takes: flat ones share none between triangles.
fn vertex_count(mesh: &Mesh) -> usize {
    if mesh.normals.is_empty() { 3 * mesh.triangles.len() } else { mesh.positions.len() }
}

/// Appends one placed mesh, which has the given number.
fn write_mesh(p: &Placed, number: u32, has_emission_maps: bool, geometry: &mut Geometry) {
    let mesh = p.mesh;
    let (first_vertex, first_triangle) = (geometry.positions.len(), geometry.triangles.len());
    let linear = DMat3::from_mat4(p.world_from_mesh);
    let mirrored = linear.determinant() < 0.0;
    // A mirror turns the winding round; swapping two corners keeps the front in front.
    let wind = |[a, b, c]: [u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
    let origin = geometry.origin;
    let local = world_positions(p).map(|v| (v - origin).as_vec3());
    if mesh.normals.is_empty() {
        // Flat: each triangle has vertices of its own.
        let positions: Vec<Vec3> = local.collect();
        for &triangle in &mesh.triangles {
            let corners = wind(triangle).map(|v| v as usize);
            let normal = flat_normal(corners.map(|v| positions[v]));
            let first = geometry.positions.len() as u32;
            geometry.triangles.push([first, first + 1, first + 2]);
            for v in corners {
                geometry.positions.push(positions[v]);
                geometry.normals.push(normal);
                if has_emission_maps {
                    geometry.emission_uvs.push(mesh.emission_uvs.get(v).copied().unwrap_or(Vec2::ZERO));
                }
                geometry.uvs.push(mesh.uvs.get(v).copied().unwrap_or(Vec2::ZERO));
                geometry.lightmap_uvs.push(mesh.lightmap_uvs.get(v).copied().unwrap_or(Vec2::ZERO));
            }
        }
    } else {
        let count = mesh.positions.len();
        geometry.positions.extend(local);
        let positions = &geometry.positions[first_vertex..];
        // The sum of the area vectors around each vertex says where its front is.
        let mut front = vec![Vec3::ZERO; count];
        for &triangle in &mesh.triangles {
            let corners = wind(triangle).map(|v| v as usize);
            let area = area_vector(corners.map(|v| positions[v])).as_vec3();
            corners.iter().for_each(|&v| front[v] += area);
            geometry.triangles.push(corners.map(|v| (first_vertex + v) as u32));
        }
        let world_from_normal = normal_matrix(linear);
        geometry.normals.extend(mesh.normals.iter().zip(&front).map(|(normal, &front)| {
            let front = front.as_dvec3().normalize_or_zero();
            let normal = (world_from_normal * normal.as_dvec3().normalize_or_zero()).normalize_or_zero();
            let normal = if normal == DVec3::ZERO { front } else { normal };
            let normal = if normal.dot(front) < 0.0 { -normal } else { normal };
            (if normal == DVec3::ZERO { DVec3::Y } else { normal }).as_vec3()
        }));
        if has_emission_maps {
            geometry.emission_uvs.extend_from_slice(&mesh.emission_uvs);
            geometry.emission_uvs.resize(first_vertex + count, Vec2::ZERO);
        }
        match mesh.uvs.is_empty() {
            true => geometry.uvs.resize(first_vertex + count, Vec2::ZERO),
            false => geometry.uvs.extend_from_slice(&mesh.uvs),
        }
        match mesh.lightmap_uvs.is_empty() {
            true => geometry.lightmap_uvs.resize(first_vertex + count, Vec2::ZERO),
            false => geometry.lightmap_uvs.extend_from_slice(&mesh.lightmap_uvs),
        }
    }
    write_colours(p, first_vertex, geometry);
    geometry.material_of.resize(geometry.triangles.len(), p.material);
    geometry.instances.push(Instance {
        name: p.name.clone(),
        mesh: number,
        world_from_mesh: DAffine3::from_mat4(p.world_from_mesh),
        triangles: first_triangle..geometry.triangles.len(),
        vertices: first_vertex..geometry.positions.len(),
        lightmap: p.lightmap,
        has_lightmap_uvs: !mesh.lightmap_uvs.is_empty(),
        lightmap_place: p.lightmap_place,
        density: p.density,
    });
}

/// Appends the vertex colours of a placed mesh whose vertices start at `first`. As long as there are none,
/// nothing is held.
fn write_colours(p: &Placed, first: usize, geometry: &mut Geometry) {
    let (mesh, count) = (p.mesh, geometry.positions.len());
    if mesh.colours.is_empty() {
        if !geometry.colours.is_empty() {
            geometry.colours.resize(count, Vec4::ONE);
        }
        return;
    }
    geometry.colours.resize(first, Vec4::ONE);
    // A colour of the scene file replaces the file's; the cut-out stays.
    let own = |colour: Vec4| if p.recoloured { Vec4::ONE.with_w(colour.w) } else { colour };
    if mesh.normals.is_empty() {
        let mirrored = DMat3::from_mat4(p.world_from_mesh).determinant() < 0.0;
        for &[a, b, c] in &mesh.triangles {
            let corners = if mirrored { [a, c, b] } else { [a, b, c] };
            geometry.colours.extend(corners.map(|v| own(mesh.colours[v as usize])));
        }
    } else {
        geometry.colours.extend(mesh.colours.iter().map(|&colour| own(colour)));
    }
    debug_assert_eq!(geometry.colours.len(), count);
}

/// Half the cross product of two edges.
fn area_vector([a, b, c]: [Vec3; 3]) -> DVec3 {
    let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
    0.5 * (b - a).cross(c - a)
}

/// The plane's unit normal; up for a triangle without area.
fn flat_normal(corners: [Vec3; 3]) -> Vec3 {
    area_vector(corners).try_normalize().unwrap_or(DVec3::Y).as_vec3()
}
