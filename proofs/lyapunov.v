(* Two statements of Barbalat, proven formally in Coq 8.16 with its standard library alone:
     - Theorem 1 (i) of the paper: V = e'P e + z'G z does not grow along MRAC, and bounds |e|;
     - the inequality for V of the sampled law with discretization "midpoint", for every sample time and every gain.
   Vectors are functions of an index of which the first n count, matrices functions of two. The page docs/proofs.md of the project says
   what is proven here and what is not. Check it with: coqc -q lyapunov.v *)

Require Import Reals Lra Lia.
Open Scope R_scope.

(** * Sums, vectors, matrices *)

Definition vector := nat -> R.
Definition matrix := nat -> nat -> R.

Fixpoint sum (n : nat) (f : nat -> R) : R :=
  match n with
  | O => 0
  | S m => sum m f + f m
  end.

Lemma sum_ext n f g : (forall i, (i < n)%nat -> f i = g i) -> sum n f = sum n g.
Proof. induction n; intros H; simpl; [reflexivity | rewrite IHn, H; auto with arith]. Qed.

Lemma sum_plus n f g : sum n (fun i => f i + g i) = sum n f + sum n g.
Proof. induction n; simpl; [ring | rewrite IHn; ring]. Qed.

Lemma sum_scal n a f : sum n (fun i => a * f i) = a * sum n f.
Proof. induction n; simpl; [ring | rewrite IHn; ring]. Qed.

Lemma sum_zero n : sum n (fun _ => 0) = 0.
Proof. induction n; simpl; [reflexivity | rewrite IHn; ring]. Qed.

Lemma sum_swap n m (f : nat -> nat -> R) : sum n (fun i => sum m (fun j => f i j)) = sum m (fun j => sum n (fun i => f i j)).
Proof.
  induction n; simpl.
  - symmetry; apply sum_zero.
  - rewrite IHn, <- sum_plus. reflexivity.
Qed.

Definition dot n (u v : vector) := sum n (fun i => u i * v i).
Definition add (u v : vector) : vector := fun i => u i + v i.
Definition scale a (u : vector) : vector := fun i => a * u i.
Definition times n (M : matrix) (v : vector) : vector := fun i => sum n (fun j => M i j * v j).
Definition same n (u v : vector) := forall i, (i < n)%nat -> u i = v i.
Definition symmetric n (M : matrix) := forall i j, (i < n)%nat -> (j < n)%nat -> M i j = M j i.

(** u'M v *)
Definition form n (M : matrix) u v := dot n u (times n M v).

Lemma dot_ext n u u' v v' : same n u u' -> same n v v' -> dot n u v = dot n u' v'.
Proof. intros Hu Hv; apply sum_ext; intros i Hi; rewrite (Hu i Hi), (Hv i Hi); reflexivity. Qed.

Lemma dot_comm n u v : dot n u v = dot n v u.
Proof. apply sum_ext; intros; ring. Qed.

Lemma dot_add_r n u v w : dot n u (add v w) = dot n u v + dot n u w.
Proof. unfold dot; rewrite <- sum_plus; apply sum_ext; intros; unfold add; ring. Qed.

Lemma dot_add_l n u v w : dot n (add u v) w = dot n u w + dot n v w.
Proof. rewrite dot_comm, dot_add_r, (dot_comm n w u), (dot_comm n w v); reflexivity. Qed.

Lemma dot_scale_r n a u v : dot n u (scale a v) = a * dot n u v.
Proof. unfold dot; rewrite <- sum_scal; apply sum_ext; intros; unfold scale; ring. Qed.

Lemma dot_scale_l n a u v : dot n (scale a u) v = a * dot n u v.
Proof. rewrite dot_comm, dot_scale_r, dot_comm; reflexivity. Qed.

Lemma form_ext n M u u' v v' : same n u u' -> same n v v' -> form n M u v = form n M u' v'.
Proof.
  intros Hu Hv; apply dot_ext; [exact Hu | intros i _].
  apply sum_ext; intros j Hj; rewrite (Hv j Hj); reflexivity.
Qed.

Lemma form_add_r n M u v w : form n M u (add v w) = form n M u v + form n M u w.
Proof.
  unfold form; rewrite <- dot_add_r; apply dot_ext; intros i _; [reflexivity |].
  unfold times, add; rewrite <- sum_plus; apply sum_ext; intros; ring.
Qed.

Lemma form_scale_r n M a u v : form n M u (scale a v) = a * form n M u v.
Proof.
  unfold form; rewrite <- dot_scale_r; apply dot_ext; intros i _; [reflexivity |].
  unfold times, scale; rewrite <- sum_scal; apply sum_ext; intros; ring.
Qed.

Lemma form_sym n M u v : symmetric n M -> form n M u v = form n M v u.
Proof.
  intros H; unfold form, dot, times.
  transitivity (sum n (fun i => sum n (fun j => u i * M i j * v j))).
  - apply sum_ext; intros i _; rewrite <- sum_scal; apply sum_ext; intros; ring.
  - rewrite sum_swap; apply sum_ext; intros j Hj.
    rewrite <- sum_scal; apply sum_ext; intros i Hi; rewrite (H i j Hi Hj); ring.
Qed.

Lemma form_add_l n M u v w : symmetric n M -> form n M (add u v) w = form n M u w + form n M v w.
Proof. intros H; rewrite (form_sym n M _ w H), form_add_r, (form_sym n M w u H), (form_sym n M w v H); reflexivity. Qed.

Lemma form_scale_l n M a u v : symmetric n M -> form n M (scale a u) v = a * form n M u v.
Proof. intros H; rewrite (form_sym n M _ v H), form_scale_r, (form_sym n M v u H); reflexivity. Qed.

(** |a|^2 - |b|^2 = 2 a'M (a - b) - |a - b|^2, on which the proof for the sampled law rests *)
Lemma form_difference n M a d : symmetric n M ->
  form n M a a - form n M (add a (scale (-1) d)) (add a (scale (-1) d)) = 2 * form n M a d - form n M d d.
Proof.
  intros H.
  rewrite form_add_r, !(form_add_l n M _ _ _ H), !form_scale_r, !(form_scale_l n M _ _ _ H), (form_sym n M d a H); ring.
Qed.

(** * Derivatives *)

Lemma derivative_sum n (f : R -> vector) (f' : vector) t :
  (forall i, (i < n)%nat -> derivable_pt_lim (fun s => f s i) t (f' i)) ->
  derivable_pt_lim (fun s => sum n (f s)) t (sum n f').
Proof.
  induction n; intros H; simpl.
  - apply derivable_pt_lim_const.
  - apply (derivable_pt_lim_plus (fun s => sum n (f s)) (fun s => f s n)); [apply IHn; auto with arith | apply H; auto with arith].
Qed.

Definition moves n (v : R -> vector) (v' : vector) t := forall i, (i < n)%nat -> derivable_pt_lim (fun s => v s i) t (v' i).

Lemma derivative_form n M (v : R -> vector) (v' : vector) t : symmetric n M -> moves n v v' t ->
  derivable_pt_lim (fun s => form n M (v s) (v s)) t (2 * form n M (v t) v').
Proof.
  intros HM Hv.
  replace (2 * form n M (v t) v') with (form n M v' (v t) + form n M (v t) v') by (rewrite (form_sym n M v' _ HM); ring).
  unfold form, dot; rewrite <- sum_plus.
  apply derivative_sum with (f := fun s i => v s i * times n M (v s) i) (f' := fun i => v' i * times n M (v t) i + v t i * times n M v' i).
  intros i Hi.
  apply (derivable_pt_lim_mult (fun s => v s i) (fun s => times n M (v s) i)); [apply Hv; exact Hi |].
  apply derivative_sum with (f := fun s j => M i j * v s j) (f' := fun j => M i j * v' j).
  intros j Hj; apply (derivable_pt_lim_scal (fun s => v s j)); apply Hv; exact Hj.
Qed.

Lemma falls (V V' : R -> R) from until t :
  from < 0 -> 0 <= t < until -> (forall s, from < s < until -> derivable_pt_lim V s (V' s)) ->
  (forall s, 0 <= s < until -> V' s <= 0) -> V t <= V 0.
Proof.
  intros Hfrom [[Ht | <-] Huntil] HV HV'; [| lra].
  destruct (MVT_cor2 V V' 0 t Ht) as [c [Hc Hin]].
  - intros c Hc; apply HV; lra.
  - assert (V' c * (t - 0) <= 0) by (assert (V' c <= 0) by (apply HV'; lra); nra).
    lra.
Qed.

(** * Theorem 1 (i)

    The plant (1) and the model (2) with u = k_0 r - theta_hat'phi, so that e' = A e - b (z'phi) with e = x - x_m and z = theta_hat - theta.
    P is symmetric, at least lambda I, and e'P A e <= 0. G is the inverse of the gain matrix, symmetric and not negative. Of the law of
    adaptation only z'G z' <= z'phi (e'P b) is used, with equality for (4); what projection and leakage take away only lowers the left side. *)

Section Theorem_1_i.

Variables (n p : nat) (A P G : matrix) (b : vector) (lambda from until : R).
Variables (e z : R -> vector) (z' phi : R -> vector).

Hypothesis P_symmetric : symmetric n P.
Hypothesis G_symmetric : symmetric p G.
Hypothesis P_positive : forall v, lambda * dot n v v <= form n P v v.
Hypothesis G_not_negative : forall v, 0 <= form p G v v.
Hypothesis A_stable : forall v, form n P v (times n A v) <= 0.
Hypothesis begins_before : from < 0.
Hypothesis error_equation : forall t, from < t < until ->
  moves n e (add (times n A (e t)) (scale (- dot p (z t) (phi t)) b)) t.
Hypothesis estimates_move : forall t, from < t < until -> moves p z (z' t) t.
Hypothesis law : forall t, 0 <= t < until -> form p G (z t) (z' t) <= dot p (z t) (phi t) * form n P (e t) b.
Hypothesis starts_at_rest : forall i, (i < n)%nat -> e 0 i = 0.

Definition V t := form n P (e t) (e t) + form p G (z t) (z t).

Lemma V_does_not_grow t : 0 <= t < until -> V t <= V 0.
Proof.
  intros Ht.
  apply (falls V (fun s => 2 * form n P (e s) (add (times n A (e s)) (scale (- dot p (z s) (phi s)) b)) + 2 * form p G (z s) (z' s)) from until).
  - exact begins_before.
  - exact Ht.
  - intros s Hs.
    apply (derivable_pt_lim_plus (fun s => form n P (e s) (e s)) (fun s => form p G (z s) (z s))).
    + apply derivative_form; [exact P_symmetric | apply error_equation; exact Hs].
    + apply derivative_form; [exact G_symmetric | apply estimates_move; exact Hs].
  - intros s Hs; rewrite form_add_r, form_scale_r.
    pose proof (A_stable (e s)); pose proof (law s Hs); lra.
Qed.

Lemma V_at_start : V 0 = form p G (z 0) (z 0).
Proof.
  unfold V. enough (form n P (e 0) (e 0) = 0) by lra.
  unfold form, dot. rewrite (sum_ext n _ (fun _ => 0)); [apply sum_zero |].
  intros i Hi; rewrite (starts_at_rest i Hi); ring.
Qed.

Theorem theorem_1_i t : 0 <= t < until -> lambda * dot n (e t) (e t) <= form p G (z 0) (z 0).
Proof.
  intros Ht; pose proof (V_does_not_grow t Ht) as HV; rewrite V_at_start in HV; unfold V in HV.
  pose proof (P_positive (e t)); pose proof (G_not_negative (z t)); lra.
Qed.

(** The bound (9) as it is printed: |e| <= sqrt(z(0)'G z(0) / lambda) *)
Corollary error_bound t : 0 < lambda -> 0 <= t < until -> sqrt (dot n (e t) (e t)) <= sqrt (form p G (z 0) (z 0) / lambda).
Proof.
  intros Hlambda Ht; apply sqrt_le_1_alt.
  apply (Rmult_le_reg_l lambda); [exact Hlambda |].
  replace (lambda * (form p G (z 0) (z 0) / lambda)) with (form p G (z 0) (z 0)) by (field; lra).
  apply theorem_1_i; exact Ht.
Qed.

End Theorem_1_i.

(** The law (4) with a gain matrix, and what a projection takes away, Gamma g with z'g >= 0: an outward normal of a convex set that contains theta. *)
Section Laws.

Variables (p : nat) (G Gamma : matrix) (z phi g z' : vector) (s : R).
Hypothesis inverse : forall v, same p (times p G (times p Gamma v)) v.
Hypothesis outward : 0 <= dot p z g.

Lemma projected_law : same p z' (add (scale s (times p Gamma phi)) (scale (-1) (times p Gamma g))) -> form p G z z' <= dot p z phi * s.
Proof.
  intros H.
  assert (Hinverse : forall v, form p G z (times p Gamma v) = dot p z v)
    by (intros v; apply dot_ext; [intros i _; reflexivity | apply inverse]).
  rewrite (form_ext p G z z z' _ (fun i _ => eq_refl) H), form_add_r, !form_scale_r, !Hinverse; lra.
Qed.

End Laws.

(** * The sampled law with discretization "midpoint"

    From one sample to the next, with x the prediction error and z = theta_hat - theta, of which x1 and z1 are the values at the next sample:
        x1 = x + T (A x1 - b (z1'phi) + w),        z1 = z + T s Gamma phi - Gamma g,        s = x1'P b,
    and z1'g >= 0. dx and dz are the steps. P A + A'P = -I is written as 2 v'P A v = -|v|^2. *)

Section Midpoint.

Variables (n p : nat) (A P G Gamma : matrix) (b phi w g : vector) (T : R).
Variables (x1 z1 dx dz : vector).

Hypothesis P_symmetric : symmetric n P.
Hypothesis G_symmetric : symmetric p G.
Hypothesis lyapunov : forall v, 2 * form n P v (times n A v) = - dot n v v.
Hypothesis inverse : forall v, same p (times p G (times p Gamma v)) v.
Hypothesis prediction : same n dx (scale T (add (add (times n A x1) (scale (- dot p z1 phi) b)) w)).
Hypothesis estimates : same p dz (add (scale (T * form n P x1 b) (times p Gamma phi)) (scale (-1) (times p Gamma g))).

Definition V1 := form n P x1 x1 + form p G z1 z1.
Definition V0 := form n P (add x1 (scale (-1) dx)) (add x1 (scale (-1) dx)) + form p G (add z1 (scale (-1) dz)) (add z1 (scale (-1) dz)).

Theorem midpoint_identity :
  V1 - V0 = - T * dot n x1 x1 + 2 * T * form n P x1 w - form n P dx dx - form p G dz dz - 2 * dot p z1 g.
Proof.
  unfold V1, V0.
  pose proof (form_difference n P x1 dx P_symmetric) as Hx.
  pose proof (form_difference p G z1 dz G_symmetric) as Hz.
  assert (Hinverse : forall v, form p G z1 (times p Gamma v) = dot p z1 v)
    by (intros v; apply dot_ext; [intros i _; reflexivity | apply inverse]).
  assert (Hdz : form p G z1 dz = T * form n P x1 b * dot p z1 phi - dot p z1 g).
  { rewrite (form_ext p G z1 z1 dz _ (fun i _ => eq_refl) estimates), form_add_r, !form_scale_r, !Hinverse; ring. }
  assert (Hdx : form n P x1 dx = T * (form n P x1 (times n A x1) - dot p z1 phi * form n P x1 b + form n P x1 w)).
  { rewrite (form_ext n P x1 x1 dx _ (fun i _ => eq_refl) prediction), form_scale_r, !form_add_r, form_scale_r; ring. }
  assert (Hlyapunov : form n P x1 (times n A x1) = - dot n x1 x1 / 2) by (pose proof (lyapunov x1); lra).
  rewrite Hdx, Hlyapunov in Hx; rewrite Hdz in Hz; lra.
Qed.

Hypothesis outward : 0 <= dot p z1 g.

Theorem midpoint_inequality :
  V1 - V0 <= - T * dot n x1 x1 + 2 * T * form n P x1 w - form n P dx dx - form p G dz dz.
Proof. rewrite midpoint_identity; lra. Qed.

End Midpoint.

(** The step has a closed form for every T and every gain. N is the inverse of I - T A; without a projection
        s = s0/(1 + T k phi'Gamma phi),   s0 = (N (x + T w - T (z'phi) b))'P b,   k = T (N b)'P b,
    solves the implicit equations above, and the denominator is never below 1. *)

Section Closed_form.

Variables (n p : nat) (A P Gamma N : matrix) (b phi w x z : vector) (T : R).

Definition implicit v := add v (scale (- T) (times n A v)).

Hypothesis P_symmetric : symmetric n P.
Hypothesis P_not_negative : forall v, 0 <= form n P v v.
Hypothesis Gamma_not_negative : forall v, 0 <= form p Gamma v v.
Hypothesis lyapunov : forall v, 2 * form n P v (times n A v) = - dot n v v.
Hypothesis T_positive : 0 < T.
Hypothesis inverse : forall v, same n (implicit (times n N v)) v.

Definition q := add x (scale T (add w (scale (- dot p z phi) b))).
Definition k := T * form n P (times n N b) b.
Definition s0 := form n P (times n N q) b.
Definition s := s0 / (1 + T * k * form p Gamma phi phi).
Definition next_z := add z (scale (T * s) (times p Gamma phi)).
Definition next_x := times n N (add x (scale T (add w (scale (- dot p next_z phi) b)))).

Lemma dot_not_negative m v : 0 <= dot m v v.
Proof. unfold dot; induction m; simpl; [lra | pose proof (Rle_0_sqr (v m)) as H; unfold Rsqr in H; lra]. Qed.

Lemma k_not_negative : 0 <= k.
Proof.
  unfold k; apply Rmult_le_pos; [lra |].
  set (y := times n N b).
  rewrite <- (form_ext n P y y (implicit y) b (fun i _ => eq_refl) (inverse b)).
  unfold implicit; rewrite form_add_r, form_scale_r.
  pose proof (P_not_negative y); pose proof (lyapunov y); pose proof (dot_not_negative n y); nra.
Qed.

Theorem denominator_at_least_1 : 1 <= 1 + T * k * form p Gamma phi phi.
Proof.
  assert (0 <= T * k * form p Gamma phi phi); [| lra].
  apply Rmult_le_pos; [apply Rmult_le_pos; [lra | apply k_not_negative] | apply Gamma_not_negative].
Qed.

Lemma times_add M u v i : times n M (add u v) i = times n M u i + times n M v i.
Proof. unfold times, add; rewrite <- sum_plus; apply sum_ext; intros; ring. Qed.

Lemma times_scale M a v i : times n M (scale a v) i = a * times n M v i.
Proof. unfold times, scale; rewrite <- sum_scal; apply sum_ext; intros; ring. Qed.

Lemma next_z_phi : dot p next_z phi = dot p z phi + T * s * form p Gamma phi phi.
Proof. unfold next_z; rewrite dot_add_l, dot_scale_l; unfold form; rewrite (dot_comm p (times p Gamma phi)); reflexivity. Qed.

Lemma next_x_is : same n next_x (add (times n N q) (scale (- (T * (T * s * form p Gamma phi phi))) (times n N b))).
Proof.
  intros i _; transitivity (times n N q i - T * (T * s * form p Gamma phi phi) * times n N b i).
  - unfold next_x, q; rewrite next_z_phi.
    rewrite !times_add, !times_scale, !times_add, !times_scale; ring.
  - unfold add, scale; ring.
Qed.

Theorem closed_form_is_consistent : form n P next_x b = s.
Proof.
  rewrite (form_ext n P _ _ b b next_x_is (fun i _ => eq_refl)), form_add_l, form_scale_l by exact P_symmetric.
  fold s0.
  pose proof denominator_at_least_1.
  replace s0 with (s * (1 + T * k * form p Gamma phi phi)) by (unfold s; field; lra).
  unfold k; ring.
Qed.

Theorem closed_form_solves :
  same n next_x (add x (scale T (add (add (times n A next_x) (scale (- dot p next_z phi) b)) w))).
Proof.
  intros i Hi; pose proof (inverse (add x (scale T (add w (scale (- dot p next_z phi) b)))) i Hi) as H.
  fold next_x in H; unfold implicit, add, scale in H; unfold add, scale; lra.
Qed.

End Closed_form.

Print Assumptions error_bound.
Print Assumptions projected_law.
Print Assumptions midpoint_inequality.
Print Assumptions closed_form_is_consistent.
Print Assumptions closed_form_solves.
