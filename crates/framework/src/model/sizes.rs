//! Sizes of a model that can change before the start, without a new description.

use std::mem::discriminant;
use std::sync::OnceLock;

use super::{Model, Standard, set_each};
use crate::controls::Controls;
use crate::error::Invalid;
use crate::system::{Causality, Declaration, Naming, Size, Variable, Variables};

/// A dimension of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// The same for all sizes.
    Fixed(usize),
    /// One of the sizes, by its number.
    Size(usize),
}

/// Sizes that can change, and which dimension of which variable each of them is.
#[derive(Debug, Clone)]
pub struct Sizes {
    list: Vec<Size>,
    /// Rows and columns of the variables, in the order of their declaration.
    shapes: Vec<[Extent; 2]>,
    /// Rows and columns of the event indicators.
    indicators: [Extent; 2],
}

impl Sizes {
    /// Sizes of a model whose sizes are fixed.
    const NONE: Sizes = Sizes { list: Vec::new(), shapes: Vec::new(), indicators: [Extent::Fixed(1); 2] };

    /// True if none can change.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// The sizes, with their present values.
    pub fn list(&self) -> &[Size] {
        &self.list
    }

    /// The present values.
    pub fn values(&self) -> Vec<usize> {
        self.list.iter().map(|size| size.value).collect()
    }

    /// Rows and columns of a variable, by its number in the order of declaration.
    pub fn of_variable(&self, number: usize) -> Option<[Extent; 2]> {
        self.shapes.get(number).copied()
    }

    /// Rows and columns of the event indicators.
    pub fn of_indicators(&self) -> [Extent; 2] {
        self.indicators
    }

    /// Finds which dimension is which size: a model is declared with the first size larger by 1, with the first two, and so on.
    fn of(model: &Model) -> Option<Sizes> {
        let description = model.description();
        if description.standard() != Standard::Fmi3 || description.designed.is_some() {
            return None;
        }
        let sizes = Sizes { list: model.kind.sizes(description.structure.clone()), ..Sizes::NONE };
        let of_user = |size: &Size| model.variables.iter().any(|v| v.elements().any(|one| one.name() == size.name));
        if sizes.is_empty() || sizes.list.iter().any(of_user) {
            return None;
        }
        let larger = |k: usize| (0..).zip(sizes.values()).map(move |(s, value)| value + usize::from(s <= k)).collect();
        let larger: Vec<Vec<usize>> = (0..sizes.list.len()).map(larger).collect();
        let others = larger.iter().map(|values| model.variables_with(values).ok()).collect::<Option<Vec<_>>>()?;
        if others.iter().any(|other| other.iter().count() != model.variables.iter().count()) {
            return None;
        }
        let shapes = model.variables.iter().enumerate().map(|(number, variable)| {
            sizes.shape(variable, &others.iter().filter_map(|other| other.iter().nth(number)).collect::<Vec<_>>())
        });
        let shapes = shapes.collect::<Option<_>>()?;
        let counts: Vec<usize> = others.iter().map(|other| other.indicators().len()).collect();
        let indicators = sizes.rows_of_indicators(model.variables.indicators().len(), &counts)?;
        Some(Sizes { shapes, indicators, ..sizes })
    }

    /// Rows and columns of a variable that has these others in models of larger sizes.
    fn shape(&self, variable: &Variable, others: &[&Variable]) -> Option<[Extent; 2]> {
        let (own, shapes) = (shape(variable), others.iter().map(|other| shape(other)).collect::<Vec<_>>());
        let extents = [0, 1].map(|k| self.extent(own[k], &shapes.iter().map(|shape| shape[k]).collect::<Vec<_>>()));
        if variable.causality == Causality::Hidden {
            return Some(extents.map(|extent| extent.unwrap_or(Extent::Fixed(1))));
        }
        let [Some(rows), Some(columns)] = extents else { return None };
        let is_fixed = [rows, columns].iter().all(|extent| matches!(extent, Extent::Fixed(_)));
        let is_plain = |v: &Variable| v.is_uniform() && v.description.len() == 1;
        let fits = |other: &&Variable| is_same(variable, other) && (is_fixed || is_plain(variable) && is_plain(other));
        others.iter().all(fits).then_some([rows, columns])
    }

    /// Extent of a dimension that has these values in models of larger sizes.
    fn extent(&self, own: usize, others: &[usize]) -> Option<Extent> {
        if others.iter().all(|other| *other == own) {
            return Some(Extent::Fixed(own));
        }
        let follows = |(s, size): (usize, &Size)| {
            let grows = others.iter().enumerate().all(|(k, other)| *other == own + usize::from(s <= k));
            (size.value == own && grows).then_some(Extent::Size(s))
        };
        self.list.iter().enumerate().find_map(follows)
    }

    /// Rows and columns of event indicators: some for each of a size, one after the other.
    fn rows_of_indicators(&self, own: usize, others: &[usize]) -> Option<[Extent; 2]> {
        if others.iter().all(|other| *other == own) {
            return Some([Extent::Fixed(own), Extent::Fixed(1)]);
        }
        let smallest = others.iter().copied().find(|other| *other > own)?;
        let each = smallest - own;
        if !own.is_multiple_of(each) || others.iter().any(|other| !other.is_multiple_of(each)) {
            return None;
        }
        let others: Vec<usize> = others.iter().map(|other| other / each).collect();
        Some([self.extent(own / each, &others)?, Extent::Fixed(each)])
    }

    fn number(&self, extent: Extent) -> usize {
        match extent {
            Extent::Fixed(number) => number,
            Extent::Size(s) => self.list[s].value,
        }
    }
}

/// Rows and columns.
fn shape(variable: &Variable) -> [usize; 2] {
    match variable.naming {
        Naming::Scalar => [1, 1],
        Naming::Vector(n) | Naming::Diagonal(n) => [n, 1],
        Naming::Matrix(rows, columns) => [rows, columns],
    }
}

/// True if two variables differ in nothing but their sizes and values.
fn is_same(one: &Variable, other: &Variable) -> bool {
    let role = |v: &Variable| (v.section, v.causality, v.variability, discriminant(&v.naming), discriminant(&v.data));
    one.name == other.name && role(one) == role(other)
}

impl Model {
    /// Sizes that can change; none but in FMI 3.0, and none in an FMU with C sources.
    pub fn sizes(&self) -> &Sizes {
        self.sizes.get_or_init(|| Sizes::of(self).unwrap_or(Sizes::NONE))
    }

    /// The model of the same description with other sizes. Arrays of other sizes have the kind's start values, where the description
    /// gives none; else those that are given, the last one repeated (in matrices on the diagonal, and 0 elsewhere). Nothing is designed
    /// yet, so that start values may be refused later.
    ///
    /// # Errors
    /// Sizes that don't fit each other, or are too large.
    pub fn resized(&self, values: &[usize]) -> Result<Model, Invalid> {
        let sizes = self.sizes();
        let as_declared = self.variables_with(&sizes.values())?;
        let mut declaration = Declaration::of(&self.description.start);
        let Model { description, kind, .. } = self;
        let (system, start) =
            kind.declare_resized(description.structure.clone(), values, &description.names, &mut declaration)?;
        let set = |variables: &mut Variables| {
            variables.take_starts(&self.variables, &as_declared);
            set_each("start", &start, |name, value| variables.set_start(name, value))
        };
        let mut model = Model::declared(description, *kind, system, declaration, set)?;
        let list = sizes.list.iter().zip(values).map(|(size, &value)| Size { value, ..size.clone() }).collect();
        let sizes = Sizes { list, ..sizes.clone() };
        for (variable, extents) in model.variables.iter().zip(&sizes.shapes) {
            if variable.causality != Causality::Hidden && shape(variable) != extents.map(|extent| sizes.number(extent))
            {
                return Err(Invalid::because(format!("`{}` does not follow these sizes", variable.name)));
            }
        }
        model.sizes = OnceLock::from(sizes);
        Ok(model)
    }

    /// The variables as the kind declares them with these sizes.
    fn variables_with(&self, sizes: &[usize]) -> Result<Variables, Invalid> {
        let Model { description, kind, .. } = self;
        let mut declaration = Declaration::of(&description.start);
        kind.declare_resized(description.structure.clone(), sizes, &description.names, &mut declaration)?;
        Controls::declare(&mut declaration);
        declaration.finish()
    }
}
