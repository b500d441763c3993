//! Linear equations of an iteration.

use super::super::body::{NonlinearBody, Responses};
use super::super::gmres::Gmres;
use super::super::tangent::{Kind, Tangent};
use super::super::{NonlinearError, Supports};
use super::Contact;
use super::approximate::Approximate;
use crate::tissue::error::LinearError;

/// Linear equations to solve, and the accuracy required.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Equations {
    /// The equations of the reused factor, solved by it alone.
    Kept,
    /// The equations of a tangent at the state of the factor, solved iteratively.
    Tangent {
        /// Kind of tangent.
        kind: Kind,
        /// Largest residual relative to the right-hand side.
        closeness: f64,
    },
}

/// Tangent with its factor and the workspace of solves.
#[derive(Clone, Debug)]
pub(super) struct Linear<const D: usize> {
    matrix: Tangent<D>,
    /// Kind of tangent factored.
    kind: Kind,
    is_definite: bool,
    /// Responses at the state of the factor.
    responses: Responses<D>,
    factor: Approximate,
    gmres: Gmres,
    /// Response of the free displacements to a unit contact force; `contact` is the contact it belongs to.
    contact_response: Vec<f64>,
    contact: Option<Contact>,
    /// A change of all displacements, and its product with the tangent.
    change: Vec<f64>,
    product: Vec<f64>,
}

impl<const D: usize> Linear<D> {
    pub(super) fn new<const N: usize>(
        body: &NonlinearBody<D, N>,
        supports: &Supports<D>,
        responses: &Responses<D>,
    ) -> Result<Self, NonlinearError> {
        let mut matrix = Tangent::new(body.elements(), supports).map_err(|_| NonlinearError::TooLarge)?;
        let mut responses = responses.clone();
        body.linearise(&mut responses);
        matrix.fill(body, &responses, Kind::Scalar);
        let factor = Approximate::new(&matrix)?;
        Ok(Linear {
            matrix,
            kind: Kind::Scalar,
            is_definite: true,
            responses,
            factor,
            gmres: Gmres::default(),
            contact_response: vec![0.0; supports.free().len()],
            contact: None,
            change: vec![0.0; supports.all()],
            product: vec![0.0; supports.all()],
        })
    }

    /// Factors the tangent at a state.
    pub(super) fn factor<const N: usize>(
        &mut self,
        body: &NonlinearBody<D, N>,
        responses: &Responses<D>,
        kind: Kind,
    ) -> Result<(), NonlinearError> {
        self.factor_by(body, responses, kind, Approximate::refactor)
    }

    /// Replaces the factor by a new one at a state.
    pub(crate) fn renew<const N: usize>(
        &mut self,
        body: &NonlinearBody<D, N>,
        responses: &Responses<D>,
    ) -> Result<(), NonlinearError> {
        self.factor_by(body, responses, Kind::Scalar, |factor, matrix| {
            *factor = Approximate::new(matrix)?;
            Ok(())
        })
    }

    fn factor_by<const N: usize>(
        &mut self,
        body: &NonlinearBody<D, N>,
        responses: &Responses<D>,
        kind: Kind,
        factor: impl Fn(&mut Approximate, &Tangent<D>) -> Result<(), LinearError>,
    ) -> Result<(), NonlinearError> {
        self.contact = None;
        (self.kind, self.is_definite) = (kind, true);
        self.responses.take(responses);
        body.linearise(&mut self.responses);
        self.matrix.fill(body, &self.responses, kind);
        match factor(&mut self.factor, &self.matrix) {
            // Far from balance the symmetric part need not be positive definite; the scalar tangent of secant laws
            // always is.
            Err(error) if (kind == Kind::Consistent || !body.has_secants()) && !is_memory(&error) => {
                (self.kind, self.is_definite) = (Kind::Scalar, false);
                body.make_definite(&mut self.responses);
                self.matrix.fill(body, &self.responses, Kind::Scalar);
                Ok(factor(&mut self.factor, &self.matrix)?)
            }
            other => Ok(other?),
        }
    }

    /// Whether the tangent factored last was positive definite.
    pub(super) fn is_definite(&self) -> bool {
        self.is_definite
    }

    /// Subtracts the product of the tangent and a change of all displacements from free forces.
    pub(crate) fn subtract<const N: usize>(
        &mut self,
        body: &NonlinearBody<D, N>,
        supports: &Supports<D>,
        equations: Equations,
        change: &[f64],
        residual: &mut [f64],
    ) {
        let kind = match equations {
            Equations::Kept => self.kind,
            Equations::Tangent { kind, .. } => kind,
        };
        body.product(kind, &self.responses, change, &mut self.product);
        for (value, &dof) in residual.iter_mut().zip(supports.free()) {
            *value -= self.product[dof as usize];
        }
    }

    /// Replaces free forces by free displacements.
    pub(super) fn solve<const N: usize>(
        &mut self,
        body: &NonlinearBody<D, N>,
        supports: &Supports<D>,
        equations: Equations,
        residual: &mut [f64],
    ) {
        let Equations::Tangent { kind, closeness } = equations else {
            return self.factor.solve_in_place(residual);
        };
        let (change, product, factor) = (&mut self.change, &mut self.product, &mut self.factor);
        let responses = &self.responses;
        let apply = |x: &[f64], y: &mut [f64]| {
            change.fill(0.0);
            for (value, &dof) in x.iter().zip(supports.free()) {
                change[dof as usize] = *value;
            }
            body.product(kind, responses, change, product);
            supports.gather(product, y);
        };
        self.gmres
            .solve(residual, closeness, apply, |x| factor.solve_in_place(x));
    }

    /// Returns the response of the free displacements to a unit contact force; it is cached with a reused factor.
    pub(crate) fn contact_response<const N: usize>(
        &mut self,
        body: &NonlinearBody<D, N>,
        supports: &Supports<D>,
        equations: Equations,
        contact: &Contact,
    ) -> &[f64] {
        let known = self
            .contact
            .as_ref()
            .is_some_and(|known| known.weights == contact.weights);
        if !known || !matches!(equations, Equations::Kept) {
            let mut contact_response = std::mem::take(&mut self.contact_response);
            contact_response.fill(0.0);
            contact.add_free(1.0, supports, &mut contact_response);
            self.solve(body, supports, equations, &mut contact_response);
            self.contact_response = contact_response;
            self.contact = Some(contact.clone());
        }
        &self.contact_response
    }
}

fn is_memory(error: &LinearError) -> bool {
    matches!(error, LinearError::FactorMemory { .. })
}
