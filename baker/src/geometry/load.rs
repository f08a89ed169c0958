//! Flattening: every file read once, every placed mesh written out in world space.

use super::lamps::lamps;
use super::lights::Groups;
use super::model::{DEFAULT_ALBEDO, Mesh, Model};
use super::notes::{self, Notes};
use super::originals::{self, Changed, File, Source};
use super::overrides::{MaterialStore, resolve, unmatched};
use super::texture::TextureStore;
use super::{Geometry, Instance, LightmapPlace, gltf, obj};
use crate::scene::{Object, Scene};
use dataset::{Error, Result};
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec2, Vec3, Vec4};
use std::collections::{BTreeMap, BTreeSet};
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
    let lamps = lamps(scene, &models, &model_of, &mut groups, &mut notes);
    let materials = MaterialStore::default();
    let mut store = Store { materials, textures, undefined: Vec::new(), limited: Vec::new() };
    let (mut placed, mut objects) = (Vec::new(), Vec::new());
    for (object, &file) in scene.objects.iter().zip(&model_of) {
        let Some(file) = file else { continue };
        let model = &models[file].1;
        let first = objects.len();
        objects.extend(
            object.world_from_file.iter().map(|&world_from_file| originals::Object { file, world_from_file }),
        );
        let albedo_max = scene.bake.albedo_max;
        place(object, model, first, &mut groups, albedo_max, &mut store, &mut placed, &mut errors);
    }
    warnings.extend(notes.lines());
    let (file_lights, merged) = groups.finish(scene, lamps, warnings);
    warnings.append(&mut store.undefined);
    warnings.extend(store.warning(scene.bake.albedo_max));
    if let Some(error) = all_of(errors) {
        return Err(error);
    }
    if let Some(group) = merged {
        let emissions = store.materials.materials.iter_mut().filter_map(|m| m.emission.as_mut());
        emissions.for_each(|emission| emission.group = emission.group.min(group));
    }
    let has_emission_maps =
        store.materials.materials.iter().any(|m| m.emission.is_some_and(|e| e.map.is_some()));
    let mut geometry = write_out(&placed, has_emission_maps)?;
    geometry.originals.sources = placed.iter().map(|p| p.source).collect();
    geometry.originals.objects = objects;
    geometry.originals.emission_unit = scene.lights.emission;
    geometry.originals.files = models.into_iter().map(|(name, model)| File::new(name, model)).collect();
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

/// What surfaces are made of, as it is gathered.
struct Store {
    materials: MaterialStore,
    textures: TextureStore,
    /// Warnings about surfaces without a material.
    undefined: Vec<String>,
    /// File and name of the materials that reflect more than the limit.
    limited: Vec<String>,
}

impl Store {
    /// The warning about materials that were limited, if there are any.
    fn warning(&self, albedo_max: f64) -> Option<String> {
        let n = self.limited.len();
        (n > 0).then(|| {
            let (those, names) = (notes::plural(n, "material"), notes::list(&self.limited, n));
            format!(
                "{those} of files ({names}): albedo above {albedo_max} is limited to that, since light would hardly fade \
                 between bounces; `albedo_max = 1` in [bake] keeps it, and so does an `albedo` of the object or part"
            )
        })
    }
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
    if model.placements.iter().all(|p| model.meshes[p.mesh].triangles.is_empty()) {
        return Err(Error::invalid(object.file.display(), "expected at least one triangle"));
    }
    Ok(model)
}

/// A mesh at a place in the world.
struct Placed<'a> {
    mesh: &'a Mesh,
    source: Source,
    world_from_mesh: DMat4,
    material: u32,
    /// Whether the scene file gives its colour in place of the file's.
    recoloured: bool,
    name: String,
    lightmap: bool,
    lightmap_place: LightmapPlace,
    density: f64,
}

/// Lists the placed meshes of an object, instance by instance; `first_object` is the first of its places
/// among those of the scene.
#[expect(clippy::too_many_arguments, reason = "one call")]
fn place<'a>(
    object: &Object,
    model: &'a Model,
    first_object: usize,
    groups: &mut Groups,
    albedo_max: f64,
    store: &mut Store,
    placed: &mut Vec<Placed<'a>>,
    errors: &mut Vec<Error>,
) {
    let file = object.file.file_name().unwrap_or_default().to_string_lossy();
    let names = |placement: &'a super::model::NodeMesh| {
        let mesh = &model.meshes[placement.mesh];
        [placement.node.as_str(), mesh.name.as_str(), model.materials[mesh.material].name.as_str()]
    };
    // What holds for each mesh does not depend on the instance.
    let mut matched = vec![false; object.parts.len()];
    let (mut limited, mut undefined) = (BTreeSet::new(), Vec::new());
    let mut list = Vec::new();
    for placement in &model.placements {
        let mesh = &model.meshes[placement.mesh];
        if mesh.triangles.is_empty() {
            continue;
        }
        let mut named: Vec<&str> = names(placement).into_iter().filter(|n| !n.is_empty()).collect();
        let overrides = resolve(object, &named, &mut matched);
        let material_place = (object.file.as_path(), mesh.material);
        let material = &model.materials[mesh.material];
        let emission = groups.emission(&overrides, material, &named, material_place);
        let (index, is_limited) = store.materials.add(
            material,
            mesh.brightest,
            &overrides,
            emission,
            albedo_max as f32,
            &mut store.textures,
        );
        if is_limited {
            limited.insert(mesh.material);
        }
        if overrides.albedo.is_none() && material.undefined {
            undefined.push(material.name.as_str());
        }
        named.dedup();
        list.push((placement, index, format!("{file}: {}", named.join("/")), overrides));
    }
    let all: Vec<&str> = model.placements.iter().flat_map(names).collect();
    let unmatched_parts = object.parts.iter().zip(&matched).filter(|(_, matched)| !**matched);
    let lamps = || model.contents.lamps.iter().map(|lamp| lamp.name.as_str());
    errors.extend(unmatched_parts.map(|(part, _)| unmatched(object, part, &all, lamps())));
    if !undefined.is_empty() {
        let meshes = notes::plural(undefined.len(), "mesh");
        undefined.retain(|name| !name.is_empty());
        undefined.sort_unstable();
        undefined.dedup();
        let names = notes::list(&undefined, undefined.len());
        let named = if names.is_empty() { names } else { format!(" ({names})") };
        let file = object.file.display();
        let line = format!("{file}: albedo {DEFAULT_ALBEDO} for want of a defined material{named}: {meshes}");
        if !store.undefined.contains(&line) {
            store.undefined.push(line);
        }
    }
    for index in limited {
        let name = match model.materials[index].name.as_str() {
            "" => "unnamed",
            name => name,
        };
        let name = format!("{file}: {name}");
        if !store.limited.contains(&name) {
            store.limited.push(name);
        }
    }
    // Glass that reflects nothing shows no light of its own.
    let clear: BTreeSet<u32> = list
        .iter()
        .map(|(_, material, ..)| *material)
        .filter(|m| store.materials.reflects_nothing(*m))
        .collect();
    for (i, &world_from_file) in object.world_from_file.iter().enumerate() {
        let number = if object.world_from_file.len() > 1 { format!(" #{i}") } else { String::new() };
        placed.extend(list.iter().map(|(placement, material, name, overrides)| Placed {
            mesh: &model.meshes[placement.mesh],
            source: Source {
                object: first_object + i,
                mesh: placement.mesh,
                node: placement.node_index,
                repeat: placement.repeat,
                changed: Changed::by(overrides),
            },
            world_from_mesh: world_from_file * placement.file_from_mesh,
            material: *material,
            recoloured: overrides.albedo.is_some(),
            name: format!("{name}{number}"),
            lightmap: overrides.lightmap.unwrap_or(!clear.contains(material)),
            lightmap_place: placement.lightmap_place,
            density: overrides.density.unwrap_or(1.0),
        }));
    }
}

/// Writes all placed meshes in world space, around the centre of their bounding box.
fn write_out(placed: &[Placed], has_emission_maps: bool) -> Result<Geometry> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (mut vertices, mut triangles) = (0, 0);
    for p in placed {
        for position in world_positions(p) {
            if !position.is_finite() {
                return Err(Error::invalid(&p.name, "its transform leads out of the range of numbers"));
            }
            (low, high) = (low.min(position), high.max(position));
        }
        triangles += p.mesh.triangles.len();
        vertices += vertex_count(p.mesh);
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
    for p in placed {
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

/// The inverse transpose up to a positive factor: cofactors, which exist for flattening transforms too, with
/// the sign of the determinant.
fn normal_matrix(linear: DMat3) -> DMat3 {
    let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    if linear.determinant() < 0.0 { -cofactors } else { cofactors }
}
